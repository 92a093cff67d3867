#!/usr/bin/env python3
"""Runs a program and appends one line of JSON to RESULTS: what it took and what it made.

measure.py LABEL --results RESULTS [--output PATH] -- PROGRAM [ARGUMENTS]

`own_bytes` is the greatest RssAnon of the process, read every 10 ms: pages of mapped files are the
system's, on all sides; `rss_bytes` counts them too. A program that prints JSON with `inside_seconds` and `inside_cpu_seconds` is
taken at its word, so that a Python peer does not pay for its imports; all others count from start to
end. Memory that the program reports itself (`peak_memory_bytes`) counts where it is greater.
"""
import argparse, json, os, subprocess, sys, tempfile, time


def rss_anon(pid):
    try:
        with open(f"/proc/{pid}/status") as status:
            for line in status:
                if line.startswith("RssAnon:"):
                    return int(line.split()[1]) << 10
    except OSError:
        pass
    return 0


def sizes(path):
    """Bytes and files of an output, a file or a folder."""
    if os.path.isfile(path):
        return os.path.getsize(path), 1
    found = [os.path.join(at, name) for at, _, names in os.walk(path) for name in names]
    return sum(map(os.path.getsize, found)), len(found)


def last_json(text):
    for line in reversed(text.splitlines()):
        try:
            value = json.loads(line)
        except ValueError:
            continue
        if isinstance(value, dict):
            return value
    return {}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("label")
    parser.add_argument("--results", required=True)
    parser.add_argument("--output")
    parser.add_argument("command", nargs="+")
    arguments = parser.parse_args()
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        started = time.perf_counter()
        child = subprocess.Popen(arguments.command, stdout=out, stderr=err)
        own = 0
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                break
            own = max(own, rss_anon(child.pid))
            time.sleep(0.01)
        seconds = time.perf_counter() - started
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        report = last_json(out.read())
        if child.returncode:
            sys.stderr.write(err.read()[-2000:])
            sys.exit(f"{arguments.label}: exit code {child.returncode}: {' '.join(arguments.command)}")
    size, files = sizes(arguments.output) if arguments.output else (0, 0)
    line = {
        "label": arguments.label,
        "seconds": report.get("inside_seconds", seconds),
        "cpu_seconds": report.get("inside_cpu_seconds", usage.ru_utime + usage.ru_stime),
        "rss_bytes": usage.ru_maxrss << 10,
        "own_bytes": max(own, report.get("peak_memory_bytes") or 0),
        "output_bytes": size,
        "files": files,
        "report": report,
    }
    with open(arguments.results, "a") as results:
        results.write(json.dumps(line) + "\n")


main()

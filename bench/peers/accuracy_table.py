#!/usr/bin/env python3
"""Prints the table of bench/accuracy.sh: accuracy_table.py REPORT.json REGIONS PEERS E

REPORT.json is of `octavo tradeoff`; REGIONS has a line 'microseconds, tab, rung' for each rung that is to be shown;
PEERS has the lines of accuracy.py."""
import json, sys

HEAD = ("method", "bits a voxel", "RMS", "AMAX", "PSNR dB", "encode MB/s", "decode MB/s", "one random 32^3")


def main():
    report, regions, peers = sys.argv[1:4]
    with open(report) as file:
        rungs = {rung["name"]: rung for rung in json.load(file)["rungs"]}
    rows = []
    with open(regions) as lines:
        for line in lines:
            micros, name = line.rstrip("\n").split("\t")
            rung = rungs[name]
            rows.append({**rung, "method": f"octavo {name}", "bits_per_voxel": rung["payload_bits_per_voxel"],
                         "decode_mb_per_sec": rung["decode_mb_per_sec_one_thread"], "region_micros": float(micros)})
    with open(peers) as lines:
        rows.extend(map(json.loads, lines))
    print("| " + " | ".join(HEAD) + " |")
    print("|" + "---|" * len(HEAD))
    for row in rows:
        psnr = "exact" if row["psnr_db"] is None else f"{row['psnr_db']:.1f}"
        micros = row["region_micros"]
        region = f"{micros:.0f} us" if micros < 10_000 else f"{micros / 1000:.0f} ms"
        print(f"| {row['method']} | {row['bits_per_voxel']:.2f} | {row['rms']:.2f} | {row['amax']:g} | {psnr} "
              f"| {row['encode_mb_per_sec']:.0f} | {row['decode_mb_per_sec']:.0f} | {region} |")


if __name__ == "__main__":
    main()

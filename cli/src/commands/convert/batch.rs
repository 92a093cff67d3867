//! Several inputs in one go: one bad scan does not stop the others.
//!
//! Jobs share the threads and the memory. At the end there is a table, and with `--json` or `--report` a
//! line of JSON for each input (schema `octavo.batch/1`).

use super::report::Report;
use super::show::{PlanJson, print_plan};
use super::{Convert, Job, warn_of_space};
use crate::commands::{human_bytes, print_json, print_notes, write_whole};
use crate::exit::{Answer, code_of_error, message};
use crate::progress::{Bar, stopped};
use preprocess::{Conversion, ConversionPlan, ConvertOptions, convert};
use serde::Serialize;
use std::ffi::OsStr;
use std::io::{self, BufRead, Write};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// What came of one input.
enum Outcome {
    Done(Box<Conversion>),
    Failed(anyhow::Error),
    /// The work was stopped before its turn came.
    NotBegun,
}

/// One line of JSON.
#[derive(Serialize)]
struct Line<'a> {
    schema: &'static str,
    input: String,
    output: String,
    ok: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
    /// What a run for this input alone would have ended with.
    exit_code: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    report: Option<Report<'a>>,
}

/// The inputs that a list names: one a line, without empty lines and those that begin with #.
pub(super) fn read_list(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let read = |reader: &mut dyn BufRead| {
        let mut inputs = Vec::new();
        // Names are bytes, and not all of them are UTF-8.
        for line in reader.split(b'\n') {
            let line = line?;
            let name = line.trim_ascii();
            if !name.is_empty() && !name.starts_with(b"#") {
                inputs.push(PathBuf::from(OsStr::from_bytes(name)));
            }
        }
        Ok::<_, io::Error>(inputs)
    };
    let inputs = if path == Path::new("-") {
        read(&mut io::stdin().lock())
    } else {
        std::fs::File::open(path).and_then(|file| read(&mut io::BufReader::new(file)))
    };
    let inputs = inputs
        .map_err(|source| preprocess::PreprocessError::Output { path: path.to_owned(), source })?;
    anyhow::ensure!(!inputs.is_empty(), "{}: this list names no input", path.display());
    Ok(inputs)
}

/// Converts all jobs.
pub(super) fn run(arguments: &Convert, jobs: &[Job]) -> anyhow::Result<Answer> {
    if !arguments.plan {
        arguments.check_report(jobs)?;
    }
    let at_once = usize::from(arguments.jobs).min(jobs.len()).max(1);
    let whole = arguments.options();
    let options = ConvertOptions {
        threads: (whole.threads / at_once).max(1),
        memory_bytes: whole.memory_bytes / at_once as u64,
        ..whole
    };
    if arguments.plan {
        return plan(arguments, jobs, &options);
    }
    let outcomes: Mutex<Vec<_>> = Mutex::new(jobs.iter().map(|_| Outcome::NotBegun).collect());
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for number in 0..at_once {
            let work = || {
                while let Some((index, job)) = take(&next, jobs) {
                    let outcome = one(arguments, job, &options, index, jobs.len());
                    outcomes.lock().unwrap_or_else(PoisonError::into_inner)[index] = outcome;
                }
            };
            let thread = std::thread::Builder::new().name(format!("job-{number}"));
            thread.spawn_scoped(scope, work).map(drop)?;
        }
        Ok::<_, io::Error>(())
    })?;
    let outcomes = outcomes.into_inner().unwrap_or_else(PoisonError::into_inner);
    let lines: Vec<_> =
        jobs.iter().zip(&outcomes).map(|(job, outcome)| line(job, outcome)).collect();
    if let Some(path) = &arguments.report {
        write_whole(path, arguments.force || arguments.resume, |file| {
            for line in &lines {
                serde_json::to_writer(&mut *file, line)?;
                writeln!(file)?;
            }
            Ok(())
        })?;
    }
    if arguments.json {
        table(&mut io::stderr().lock(), &lines, &outcomes)?;
        lines.iter().try_for_each(print_json)?;
    } else {
        table(&mut io::stdout().lock(), &lines, &outcomes)?;
    }
    if stopped() {
        return Err(preprocess::PreprocessError::Cancelled.into());
    }
    Ok(if lines.iter().all(|line| line.ok) { Answer::Done } else { Answer::No })
}

/// The next job, unless the work is to stop.
fn take<'a>(next: &AtomicUsize, jobs: &'a [Job]) -> Option<(usize, &'a Job)> {
    if stopped() {
        return None;
    }
    let index = next.fetch_add(1, Ordering::Relaxed);
    jobs.get(index).map(|job| (index, job))
}

fn one(
    arguments: &Convert,
    job: &Job,
    options: &ConvertOptions,
    index: usize,
    all: usize,
) -> Outcome {
    let convert = || {
        let source = arguments.open(job)?;
        print_notes(&source);
        let plan = ConversionPlan::new(&source, &job.output, options)?;
        let what = format!("{} of {all}: {}", index + 1, job.input.display());
        let bar = Bar::new(what, plan.bricks);
        let done = convert(&source, &job.output, options, &bar);
        bar.finish();
        Ok::<_, anyhow::Error>(done?)
    };
    match convert() {
        Ok(done) => Outcome::Done(Box::new(done)),
        Err(error) => {
            // Said at once: the others may take hours.
            eprintln!("octavo: {}", message(&error));
            Outcome::Failed(error)
        }
    }
}

/// Prints what would happen to each input.
fn plan(arguments: &Convert, jobs: &[Job], options: &ConvertOptions) -> anyhow::Result<Answer> {
    let mut answer = Answer::Done;
    for job in jobs {
        let plan = arguments
            .open(job)
            .and_then(|source| ConversionPlan::new(&source, &job.output, options));
        match plan {
            Ok(plan) if arguments.json => print_json(&PlanJson::new(&plan, &job.output, options))?,
            Ok(plan) => {
                print_plan(&plan, &job.output)?;
                warn_of_space(&plan, job, options);
            }
            Err(error) => {
                eprintln!("octavo: {error}");
                answer = Answer::No;
            }
        }
    }
    Ok(answer)
}

fn line<'a>(job: &Job, outcome: &'a Outcome) -> Line<'a> {
    let (ok, error, exit_code, report) = match outcome {
        Outcome::Done(done) => (true, None, 0, Some(Report::of(done))),
        Outcome::Failed(error) => (false, Some(message(error)), code_of_error(error), None),
        Outcome::NotBegun => (false, Some("stopped before its turn came".into()), 3, None),
    };
    let [input, output] = [&job.input, &job.output].map(|path| path.display().to_string());
    Line { schema: "octavo.batch/1", input, output, ok, error, exit_code, report }
}

/// One row an input, and a last one that sums up.
fn table(out: &mut dyn Write, lines: &[Line<'_>], outcomes: &[Outcome]) -> io::Result<()> {
    let width = lines.iter().map(|line| line.input.chars().count()).max().unwrap_or(0).clamp(5, 60);
    writeln!(
        out,
        "{:width$}  {:>9}  {:>11}  {:>8}  result",
        "input", "seconds", "store", "PSNR dB"
    )?;
    let (mut secs, mut bytes, mut failed) = (0.0, 0, 0);
    for (line, outcome) in lines.iter().zip(outcomes) {
        let name = &line.input;
        match outcome {
            Outcome::Done(done) => {
                secs += done.total_secs;
                bytes += done.file_bytes;
                let psnr = done.metadata.psnr_db().map_or("exact".into(), |db| format!("{db:.1}"));
                let store = human_bytes(done.file_bytes);
                let secs = done.total_secs;
                writeln!(
                    out,
                    "{name:width$}  {secs:>9.2}  {store:>11}  {psnr:>8}  {}",
                    line.output
                )?;
            }
            Outcome::Failed(_) | Outcome::NotBegun => {
                failed += 1;
                let error = line.error.as_deref().unwrap_or_default();
                writeln!(
                    out,
                    "{name:width$}  {:>9}  {:>11}  {:>8}  FAILED: {error}",
                    "-", "-", "-"
                )?;
            }
        }
    }
    let count = format!("{} of {} done", lines.len() - failed, lines.len());
    writeln!(out, "{count:width$}  {secs:>9.2}  {:>11}", human_bytes(bytes))
}

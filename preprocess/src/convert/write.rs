//! The walk on one thread, and the writer, which completes records and commits, on the caller's.

use super::brick::{BrickEncoder, BrickOutput};
use super::plan::ConversionPlan;
use super::resume::{State, kept_bytes};
use super::tree::{Beneath, Tree};
use crate::error::PreprocessError;
use crate::progress::Progress;
use crate::source::Source;
use crate::value_stats::VolumeValues;
use crate::walk::{Buffers, Earlier, Octet, Sink, walk};
use octree_store::{NodeKey, Sample, StoreWriter};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Instant;

/// What is to be done, from where on.
#[derive(Debug)]
pub(super) struct Work<'a> {
    pub(super) source: &'a Source,
    pub(super) plan: &'a ConversionPlan,
    pub(super) state: State,
    /// Parents whose children are done.
    pub(super) pending: HashMap<NodeKey, Beneath>,
}

/// What the walk says to the writer.
enum Message {
    /// Write this octet.
    Octet(Octet<BrickOutput>),
    /// Commit, and answer when so many octets are durable.
    MakeDurable(u64, SyncSender<()>),
}

/// The walk's end of the channel.
struct ToWriter<'a> {
    sender: SyncSender<Message>,
    progress: &'a dyn Progress,
    /// Octets that are durable, as the writer knows.
    durable: &'a AtomicU64,
}

impl Sink<BrickOutput> for ToWriter<'_> {
    fn take(&mut self, octet: Octet<BrickOutput>) -> Result<(), PreprocessError> {
        if self.progress.should_stop() {
            return Err(PreprocessError::Cancelled);
        }
        // A writer that has stopped says why itself.
        self.sender.send(Message::Octet(octet)).map_err(|_| PreprocessError::Cancelled)
    }

    fn wait_until_durable(&mut self, octets: u64) -> Result<(), PreprocessError> {
        if self.durable.load(Ordering::Acquire) >= octets {
            return Ok(());
        }
        let (answer, answered) = sync_channel(1);
        let asked = self.sender.send(Message::MakeDurable(octets, answer)).is_ok();
        if asked && answered.recv().is_ok() { Ok(()) } else { Err(PreprocessError::Cancelled) }
    }
}

/// What is known when every brick is written.
#[derive(Debug)]
pub(super) struct Written {
    /// The source's values.
    pub(super) values: VolumeValues,
    /// Voxels that the upscaler clamped.
    pub(super) clamped: u64,
    /// Seconds during which the writer was busy.
    pub(super) writer_busy_secs: f64,
}

/// Walks the source and writes every brick. Work that is stopped is committed first.
pub(super) fn make_bricks<T: Sample>(
    work: Work<'_>,
    encoder: &BrickEncoder<'_>,
    writer: &mut StoreWriter,
    earlier: Earlier,
    progress: &dyn Progress,
) -> Result<Written, PreprocessError> {
    let Work { source, plan, state, pending } = work;
    let pool = crate::pool(plan.threads)?;
    let buffers = Buffers::reserved(plan.octets, plan.octet_payload_bytes);
    let durable = AtomicU64::new(earlier.octets);
    let mut writing = Writing {
        tree: Tree::new(plan.geometry, encoder.rules.empty_value, pending),
        octets: state.octets,
        bricks: state.bricks,
        values: state.values.clone(),
        clamped: state.clamped,
        state,
        source_bytes: 0,
        commit_bytes: plan.commit_source_bytes,
        durable: &durable,
        buffers: &buffers,
        sample_bytes: size_of::<T>() as u64,
        writer,
    };
    thread::scope(|scope| {
        let (sender, receiver) = sync_channel(plan.octets_waiting);
        let (buffers, durable) = (&buffers, &durable);
        let walking = thread::Builder::new()
            .name("walk".into())
            .spawn_scoped(scope, move || {
                let mut sink = ToWriter { sender, progress, durable };
                walk::<T, _>(
                    source,
                    &plan.geometry,
                    &pool,
                    &plan.walk,
                    encoder,
                    buffers,
                    &earlier,
                    &mut sink,
                )
            })
            .map_err(PreprocessError::Thread)?;
        let written = writing.write_all(receiver, progress);
        let walked = walking.join().map_err(|_| PreprocessError::Panic { thread: "walk" })?;
        let writer_busy_secs = written?;
        if let Err(error) = walked {
            if matches!(error, PreprocessError::Cancelled) {
                writing.commit()?;
                writing.writer.wait()?;
            }
            return Err(error);
        }
        Ok(Written { values: writing.values, clamped: writing.clamped, writer_busy_secs })
    })
}

/// The writer's side.
struct Writing<'a> {
    writer: &'a mut StoreWriter,
    tree: Tree,
    state: State,
    octets: u64,
    bricks: u64,
    values: VolumeValues,
    clamped: u64,
    /// Bytes of the source in the bricks of level 0 since the last commit.
    source_bytes: u64,
    /// After so many of them work is committed.
    commit_bytes: u64,
    sample_bytes: u64,
    durable: &'a AtomicU64,
    buffers: &'a Buffers<u8>,
}

impl Writing<'_> {
    /// Completes and writes octets until no more come; returns the seconds it was busy.
    fn write_all(
        &mut self,
        messages: Receiver<Message>,
        progress: &dyn Progress,
    ) -> Result<f64, PreprocessError> {
        let mut busy_secs = 0.0;
        for message in messages {
            let started = Instant::now();
            let before = self.bricks;
            match message {
                Message::Octet(octet) => self.write(octet)?,
                Message::MakeDurable(octets, answer) => {
                    if self.writer.durable_mark()? < octets {
                        self.commit()?;
                        self.writer.wait()?;
                    }
                    // One who no longer waits has failed, and says why itself.
                    let _ = answer.send(());
                }
            }
            self.durable.fetch_max(self.writer.durable_mark()?, Ordering::Release);
            busy_secs += started.elapsed().as_secs_f64();
            progress.bricks_done(self.bricks - before);
        }
        Ok(busy_secs)
    }

    fn write(&mut self, octet: Octet<BrickOutput>) -> Result<(), PreprocessError> {
        for visited in &octet.bricks {
            if let Some(values) = &visited.output.values {
                self.values.add(values);
                self.source_bytes += self.sample_bytes * values.voxels();
            }
        }
        let (mut records, beneath) = self.tree.complete(&octet.bricks);
        let kept =
            beneath.map_or_else(Vec::new, |beneath| kept_bytes(beneath, octet.block_checksum));
        self.writer.append(&mut records, &octet.payloads, kept)?;
        self.octets += 1;
        self.clamped += octet.clamped;
        self.bricks += records.len() as u64;
        self.buffers.give(octet.payloads);
        if self.source_bytes >= self.commit_bytes {
            self.commit()?;
        }
        Ok(())
    }

    fn commit(&mut self) -> Result<(), PreprocessError> {
        let state = self.state.at(self.octets, self.bricks, self.clamped, &self.values);
        self.source_bytes = 0;
        Ok(self.writer.commit(&state.to_bytes(), self.octets)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;

    #[test]
    fn a_slot_is_filled_anew_only_when_what_needed_it_is_durable() {
        let (sender, receiver) = sync_channel(1);
        let durable = AtomicU64::new(7);
        let mut walk = ToWriter { sender, progress: &NoProgress, durable: &durable };
        walk.wait_until_durable(7).unwrap();
        assert!(receiver.try_recv().is_err(), "nobody is asked for what is known");
        let durable = &durable;
        thread::scope(|scope| {
            let writer = move || match receiver.recv().unwrap() {
                Message::MakeDurable(octets, answer) => {
                    durable.store(octets, Ordering::Release);
                    answer.send(()).unwrap();
                }
                Message::Octet(_) => unreachable!("none was sent"),
            };
            thread::Builder::new().spawn_scoped(scope, writer).unwrap();
            walk.wait_until_durable(8).unwrap();
            assert_eq!(durable.load(Ordering::Acquire), 8, "the writer is asked, and waited for");
        });
        // A writer that is gone answers nobody.
        assert!(matches!(walk.wait_until_durable(9), Err(PreprocessError::Cancelled)));
    }
}

//! What a walk asks of its sink, held against the definition of what a slot is needed for.

use super::*;
use crate::level_window::Slots;
use crate::source::SourceOptions;

/// Leaves bricks as they are.
struct Nothing;

impl Visitor<u8> for Nothing {
    type Output = ();
    type Scratch = ();

    fn visit(
        &self,
        _: NodeKey,
        _: &Core,
        _: &mut [u8],
        (): &mut (),
        _: &mut Vec<u8>,
    ) -> Result<(), PreprocessError> {
        Ok(())
    }
}

/// What a sink is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Told {
    /// An octet of a level's row.
    Octet(u8, u64),
    /// That so many octets must be durable.
    Durable(u64),
}

#[derive(Default)]
struct Listener(Vec<Told>);

impl Sink<()> for Listener {
    fn take(&mut self, octet: Octet<()>) -> Result<(), PreprocessError> {
        let key = octet.bricks[0].key;
        self.0.push(Told::Octet(key.level(), key.brick_xyz()[2] / 2));
        Ok(())
    }

    fn wait_until_durable(&mut self, octets: u64) -> Result<(), PreprocessError> {
        self.0.push(Told::Durable(octets));
        Ok(())
    }
}

#[test]
fn a_slot_is_filled_anew_only_when_all_that_read_it_are_durable() {
    let (dims_xyz, core, overlap) = ([20, 23, 331], 8, 2);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a_20x23x331_u8.raw");
    std::fs::write(&path, vec![7; 20 * 23 * 331]).unwrap();
    let source = Source::open(&path, &SourceOptions::default()).unwrap();
    let geometry = Geometry::new(dims_xyz, core, overlap).unwrap();
    let mut offset = 0;
    let layouts = geometry.levels().skip(1).map(|level| {
        let slots = Slots { offset, count: level_window_chunks(&geometry, level) };
        let layout = Layout::new(&geometry, level, 1, slots);
        offset += layout.bytes();
        layout
    });
    let layouts = layouts.collect();
    let scratch = tempfile::tempfile().unwrap();
    scratch.set_len(offset).unwrap();
    let options = WalkOptions {
        octets_ahead: 3,
        downsample: DownsampleFilter::Mean,
        layouts,
        stream_place: WindowPlace::Memory,
        stream_chunk: 4,
        stream_window_chunks: 0,
        stream_chunks_ahead: 0,
    };
    let pool = crate::pool(2).unwrap();
    let earlier = Earlier { octets: 0, scratch: Arc::new(scratch.into()) };
    let mut listener = Listener::default();
    let buffers = Buffers::default();
    walk::<u8, _>(&source, &geometry, &pool, &options, &Nothing, &buffers, &earlier, &mut listener)
        .unwrap();

    let told = listener.0;
    let (core, overlap) = (u64::from(core), u64::from(overlap));
    let mut reused = 0;
    for level in geometry.levels().skip(1) {
        let slots = level_window_chunks(&geometry, level);
        for chunk in slots..geometry.grid_at(level)[2] {
            let before = chunk - slots;
            let reads = |row: u64| {
                row * 2 * core < (before + 1) * core + overlap
                    && (row + 1) * 2 * core + overlap > before * core
            };
            // The count of octets up to the last that reads what is in the slot.
            let (mut octets, mut needed) = (0, 0);
            for told in &told {
                if let Told::Octet(of, row) = *told {
                    octets += 1;
                    needed = if of == level && reads(row) { octets } else { needed };
                }
            }
            // A level's row makes one chunk of the level above.
            let filled = told.iter().position(|told| *told == Told::Octet(level - 1, chunk));
            let waited = told[..filled.unwrap()]
                .iter()
                .any(|told| matches!(told, Told::Durable(octets) if *octets >= needed));
            assert!(waited, "chunk {chunk} of level {level}: {needed} octets");
            reused += 1;
        }
    }
    assert!(reused > 20, "{reused}");
}

//! How the pages of a file with several channels or times follow each other, and which of them make the
//! volume that was asked for.

use super::super::{SourceError, SourceOptions};
use std::path::Path;

/// An axis that pages follow each other along.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    Z,
    Channel,
    Time,
}

/// The sizes of the axes, fastest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PageOrder {
    pub(super) axes: [(Axis, u64); 3],
}

impl PageOrder {
    /// Pages that are slices.
    pub(super) fn slices(pages: u64) -> Self {
        Self { axes: [(Axis::Z, pages), (Axis::Channel, 1), (Axis::Time, 1)] }
    }

    /// An axis's size.
    pub(super) fn size(&self, axis: Axis) -> u64 {
        self.axes.iter().find(|(other, _)| *other == axis).map_or(1, |&(_, size)| size)
    }

    /// Pages in all; `None` where no file can have so many.
    pub(super) fn pages(&self) -> Option<u64> {
        self.axes.iter().try_fold(1_u64, |pages, &(_, size)| pages.checked_mul(size))
    }

    /// The page at a place.
    pub(super) fn index(&self, at: [(Axis, u64); 3]) -> u64 {
        let along = |axis| at.iter().find(|(other, _)| *other == axis).map_or(0, |&(_, at)| at);
        self.axes.iter().rev().fold(0, |index, &(axis, size)| index * size + along(axis))
    }

    /// Where a page lies along z, channel and time.
    pub(super) fn place(&self, mut index: u64) -> [u64; 3] {
        let mut place = [0; 3];
        for &(axis, size) in &self.axes {
            place[axis as usize] = index % size;
            index /= size;
        }
        place
    }

    /// Many times or many channels of a single slice are slices to whoever asks for none of them: tifffile
    /// writes stacks for ImageJ so unless axes are named. What to tell the user comes with it.
    pub(super) fn with_slices(self, options: &SourceOptions) -> (Self, Option<String>) {
        let [slices, channels, times] =
            [Axis::Z, Axis::Channel, Axis::Time].map(|axis| self.size(axis));
        let (many, count, what, flag) = match (slices, channels, times) {
            (1, 2.., 1) if options.channel.is_none() => {
                (Axis::Channel, channels, "channels", "channel")
            }
            (1, 1, 2..) if options.time.is_none() => (Axis::Time, times, "times", "time"),
            _ => return (self, None),
        };
        let axes = self.axes.map(|(axis, size)| match axis {
            Axis::Z => (many, 1),
            axis if axis == many => (Axis::Z, size),
            axis => (axis, size),
        });
        let note = format!(
            "it says that it is one slice at {count} {what}: these are taken for slices (--{flag} N takes one)"
        );
        (Self { axes }, Some(note))
    }

    /// The channel and time that were asked for, and what to tell the user.
    pub(super) fn choose(
        &self,
        path: &Path,
        options: &SourceOptions,
    ) -> Result<(u64, u64, Option<String>), SourceError> {
        let [channels, times] = [Axis::Channel, Axis::Time].map(|axis| self.size(axis));
        let chosen = |count, asked: Option<u64>| {
            let asked = asked.unwrap_or(0);
            let path = path.to_owned();
            if asked < count {
                Ok(asked)
            } else {
                Err(SourceError::NoSuchVolume { path, count, asked })
            }
        };
        let time = chosen(times, options.time)?;
        let channel = chosen(channels, options.channel)?;
        let note = (channels > 1 || times > 1).then(|| {
            format!(
                "it holds {times} times and {channels} channels: time {time} of channel {channel} is \
                 used (--time and --channel choose another)"
            )
        });
        Ok((channel, time, note))
    }

    /// The pages of a channel and a time, slice by slice.
    pub(super) fn volume(self, channel: u64, time: u64) -> impl Iterator<Item = u64> {
        (0..self.size(Axis::Z))
            .map(move |z| self.index([(Axis::Z, z), (Axis::Channel, channel), (Axis::Time, time)]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_page_has_one_place(sizes in prop::array::uniform3(1_u64..7), order in 0_usize..6) {
            let axes = [Axis::Z, Axis::Channel, Axis::Time];
            let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
            let order = PageOrder { axes: orders[order].map(|i| (axes[i], sizes[i])) };
            for index in 0..order.pages().unwrap() {
                let [z, c, t] = order.place(index);
                let at = [(Axis::Time, t), (Axis::Z, z), (Axis::Channel, c)];
                prop_assert_eq!(order.index(at), index);
                prop_assert_eq!(order.volume(c, t).nth(z as usize), Some(index));
            }
        }
    }
}

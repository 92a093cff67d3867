//! What the renderer saw, taken into the tree (2010 text, section 5; 2008 text, section 6).
//!
//! The renderer clears one byte a node of the index before a frame, once for all views, and sets those of the
//! leaves that a ray enters before it ends, empty ones too. A node is visible if a leaf beneath it is, so a leaf that
//! was seen marks all above it. Marks carry the feedback's number: what is not marked anew is out of sight, and
//! nothing has to be cleared.
//!
//! A node is refined only if the last feedback saw it, so data behind an opaque wall is never asked for. It is
//! kept for `linger_frames` after it was last needed, so a cut does not flicker when a camera trembles. When
//! children turn out to be hidden where their parent was not (a renderer that does not mark empty leaves can do that),
//! the view gives up on them after three times.

use super::index::SpatialIndex;
use super::tree::Tree;

/// One byte for each node of an index.
#[derive(Debug, Clone, Copy)]
pub enum Feedback<'a> {
    /// Not zero: a ray entered the leaf. All its children in view are wanted then.
    Nodes(&'a [u8]),
    /// Bit `x + 2y + 4z`: a ray entered that eighth of the leaf. Only those children are wanted then.
    Octants(&'a [u8]),
}

impl Feedback<'_> {
    fn octants(&self, node: usize) -> u8 {
        match self {
            Self::Nodes(bytes) => {
                bytes.get(node).map_or(0, |&byte| if byte == 0 { 0 } else { 0xff })
            }
            Self::Octants(bytes) => bytes.get(node).copied().unwrap_or(0),
        }
    }
}

/// Marks what was seen of `index` in the tree, as feedback number `number`.
pub(super) fn mark(tree: &mut Tree, index: &SpatialIndex, feedback: Feedback, number: u32) {
    for (at, (&place, &key)) in index.places().iter().zip(index.keys()).enumerate() {
        let octants = feedback.octants(at);
        // The tree may have changed since the index was built, and the place be another's.
        if octants == 0 || tree.get(place).key != key || !tree.get(place).is_present() {
            continue;
        }
        let node = tree.get_mut(place);
        let before = if node.seen == number { node.seen_octants } else { 0 };
        (node.seen, node.seen_octants) = (number, before | octants);
        let (mut octant, mut above) = (node.key.octant(), node.parent);
        while above != super::tree::NONE {
            let node = tree.get_mut(above);
            let (seen, bit) = (node.seen == number, 1 << octant);
            if seen && node.seen_octants & bit != 0 {
                break;
            }
            node.seen_octants = if seen { node.seen_octants | bit } else { bit };
            node.seen = number;
            (octant, above) = (node.key.octant(), node.parent);
        }
    }
}

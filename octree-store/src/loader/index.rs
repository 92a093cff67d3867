//! The spatial index: the tree as a linear array that a ray can walk (2008 text, 5.1; 2010 text, section 5).
//!
//! Node 0 is the top level. A node's eight children lie side by side, those outside the volume among
//! them, marked absent. Neighbour pointers lead through each face to the node of the same level beside it, or to the
//! smallest one that encloses that place; out of the volume they lead nowhere.
//!
//! Every leaf has something to show: its own brick, one value, nothing, or the brick of the nearest node
//! above it (`data_level` says whose). It is built from parents to children in one sweep: what lies beyond a child's outer
//! face is the parent's neighbour there, or that neighbour's child.

use super::tree::{NONE, Node, Presence, Tree};
use crate::key::NodeKey;
use crate::record::BrickState;
use crate::sample::SampleType;

/// The nearest 32-bit float that is finite.
fn narrowed(value: f64) -> f32 {
    value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32
}

/// What stands where a pointer leads nowhere.
pub const NO_NODE: u32 = u32::MAX;

/// What a node shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NodeData {
    /// The brick in this slot.
    Slot(u32),
    /// One value, `texel_range[0]`, everywhere.
    Uniform,
    /// Nothing that can be seen, neither here nor beneath.
    Empty,
    /// Nothing yet: not even the top level's brick is in core.
    Missing,
    /// It lies outside the volume; no pointer leads to it.
    Absent,
}

/// One node of the index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IndexNode {
    /// The node it is a child of; [`NO_NODE`] of the first.
    pub parent: u32,
    /// The first of its eight children; [`NO_NODE`] of a leaf.
    pub first_child: u32,
    /// What it shows. Inner nodes have data too, to filter between levels.
    pub data: NodeData,
    /// Its level.
    pub level: u8,
    /// The level of the node whose data it shows: its own, or a higher one's above it.
    pub data_level: u8,
    /// The values of texels 0 and 1 of that data.
    pub texel_range: [f64; 2],
    /// The nodes beyond its faces at -x, +x, -y, +y, -z, +z, or [`NO_NODE`].
    pub neighbours: [u32; 6],
}

/// The index of one frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SpatialIndex {
    serial: u64,
    nodes: Vec<IndexNode>,
    keys: Vec<NodeKey>,
    places: Vec<u32>,
}

/// Slots of the packed layouts that are none, counted down from the greatest number.
const EMPTY: u32 = 0;
const UNIFORM: u32 = 1;
const MISSING: u32 = 2;
const ABSENT: u32 = 3;

/// Bits of a slot in the narrow layout; level and data level take five each.
const NARROW_SLOT_BITS: u32 = 22;

impl SpatialIndex {
    /// Which index it is: feedback names it. Equal numbers are equal indices.
    pub fn serial(&self) -> u64 {
        self.serial
    }

    /// The nodes; none until the top level's record is in core.
    pub fn nodes(&self) -> &[IndexNode] {
        &self.nodes
    }

    /// The keys of the nodes.
    pub fn keys(&self) -> &[NodeKey] {
        &self.keys
    }

    pub(super) fn places(&self) -> &[u32] {
        &self.places
    }

    /// The leaves: those that a ray goes through.
    pub fn leaves(&self) -> impl Iterator<Item = (NodeKey, &IndexNode)> {
        self.keys
            .iter()
            .zip(&self.nodes)
            .filter(|(_, node)| node.first_child == NO_NODE && node.data != NodeData::Absent)
            .map(|(key, node)| (*key, node))
    }

    /// The index of a tree of about so many nodes.
    pub(super) fn build(tree: Option<&Tree>, serial: u64, expected: usize) -> Self {
        let mut index = Self {
            serial,
            nodes: Vec::with_capacity(expected),
            keys: Vec::with_capacity(expected),
            places: Vec::with_capacity(expected),
        };
        let Some(tree) = tree else { return index };
        index.push(tree, 0, NO_NODE);
        // Breadth first, so that a node stands before all beneath it.
        let mut at = 0;
        while at < index.nodes.len() {
            let children = tree.children(index.places[at]);
            if !children.is_empty() {
                index.nodes[at].first_child = index.nodes.len() as u32;
                for child in children {
                    index.push(tree, child, at as u32);
                }
            }
            at += 1;
        }
        index.connect();
        index
    }

    fn push(&mut self, tree: &Tree, place: u32, parent: u32) {
        let node = tree.get(place);
        let above = self.nodes.get(parent as usize);
        self.keys.push(node.key);
        self.places.push(place);
        self.nodes.push(shown(node, parent, above));
    }

    /// Finds the neighbours of every node, parents first.
    fn connect(&mut self) {
        for at in 0..self.nodes.len() {
            let IndexNode { first_child: first, level, neighbours, .. } = self.nodes[at];
            if first == NO_NODE {
                continue;
            }
            // What lies beyond each face of this node: children of its own level, or one enclosing node.
            let beyond = neighbours.map(|n| {
                let node = self.nodes.get(n as usize)?;
                Some(if node.level == level && node.first_child != NO_NODE {
                    (node.first_child, true)
                } else {
                    (n, false)
                })
            });
            for octant in 0..8_u32 {
                let mut found = [NO_NODE; 6];
                for (face, found) in found.iter_mut().enumerate() {
                    let bit = 1_u32 << (face / 2);
                    let outward = (octant & bit != 0) == (face % 2 == 1);
                    let candidate = if outward {
                        match beyond[face] {
                            None => continue,
                            Some((enclosing, false)) => {
                                *found = enclosing;
                                continue;
                            }
                            Some((children, true)) => children + (octant ^ bit),
                        }
                    } else {
                        first + (octant ^ bit)
                    };
                    if self.nodes[candidate as usize].data != NodeData::Absent {
                        *found = candidate;
                    }
                }
                self.nodes[(first + octant) as usize].neighbours = found;
            }
        }
    }

    /// The narrow layout, 192 bits a node: six 32-bit words (2010 text, section 5), or `None` where it does not
    /// suffice: above 65,535 nodes or 4,194,300 slots, for samples other than 8- and 16-bit integers, or where texels 0 and 1 do
    /// not stand for whole values of that type.
    ///
    /// | word | low 16 bits | high 16 bits |
    /// |---|---|---|
    /// | 0 | parent | first child |
    /// | 1 | slot (22 bits), then data level (5) and level (5) | |
    /// | 2 | value of texel 0 | value of texel 1 |
    /// | 3, 4, 5 | neighbour at -x, -y, -z | at +x, +y, +z |
    ///
    /// Pointers that lead nowhere are 0xffff. Slots from 0x3ffffc on are none: 0x3fffff empty, 0x3ffffe uniform, 0x3ffffd missing,
    /// 0x3ffffc absent. Values are less the sample type's least value, so that signed ones fit.
    pub fn narrow(&self, sample_type: SampleType) -> Option<Vec<[u32; 6]>> {
        let limit = 1_u32 << NARROW_SLOT_BITS;
        let (least, greatest) = sample_type.limits();
        let whole = |v: f64| v.fract() == 0.0 && (least..=greatest).contains(&v);
        let fits = |node: &IndexNode| match node.data {
            NodeData::Slot(slot) => slot < limit - 4 && node.texel_range.into_iter().all(whole),
            NodeData::Uniform => whole(node.texel_range[0]),
            _ => true,
        };
        if !sample_type.is_integer()
            || sample_type.bytes() > 2
            || self.nodes.len() > usize::from(u16::MAX)
            || !self.nodes.iter().all(fits)
        {
            return None;
        }
        let pair = |low: u32, high: u32| low & 0xffff | high << 16;
        let value = |v: f64| (v - least) as u16;
        Some(
            self.nodes
                .iter()
                .map(|node| {
                    let [low, high] = node.texel_range;
                    let [x0, x1, y0, y1, z0, z1] = node.neighbours;
                    let slot = packed_slot(node.data, limit - 1);
                    let levels = u32::from(node.data_level) | u32::from(node.level) << 5;
                    [
                        pair(node.parent, node.first_child),
                        slot | levels << NARROW_SLOT_BITS,
                        pair(value(low).into(), value(high).into()),
                        pair(x0, x1),
                        pair(y0, y1),
                        pair(z0, z1),
                    ]
                })
                .collect(),
        )
    }

    /// The wide layout, 384 bits a node: parent, first child, slot, levels (level in the low byte, data level in
    /// the next), the values of texels 0 and 1 as 32-bit floats, and six neighbours at -x, +x, -y, +y, -z, +z.
    /// Pointers that lead nowhere are 0xffff_ffff; slots that are none count down from there: empty, uniform, missing, absent.
    pub fn wide(&self) -> Vec<[u32; 12]> {
        self.nodes
            .iter()
            .map(|node| {
                let [x0, x1, y0, y1, z0, z1] = node.neighbours;
                let levels = u32::from(node.level) | u32::from(node.data_level) << 8;
                let [low, high] = node.texel_range.map(|v| narrowed(v).to_bits());
                let slot = packed_slot(node.data, u32::MAX);
                [node.parent, node.first_child, slot, levels, low, high, x0, x1, y0, y1, z0, z1]
            })
            .collect()
    }
}

fn packed_slot(data: NodeData, greatest: u32) -> u32 {
    match data {
        NodeData::Slot(slot) => slot,
        NodeData::Empty => greatest - EMPTY,
        NodeData::Uniform => greatest - UNIFORM,
        NodeData::Missing => greatest - MISSING,
        NodeData::Absent => greatest - ABSENT,
    }
}

/// What a node shows: its own, or what its parent shows.
fn shown(node: &Node, parent: u32, above: Option<&IndexNode>) -> IndexNode {
    let inherited = above.map_or((NodeData::Missing, node.level, [0.0; 2]), |above| {
        (above.data, above.data_level, above.texel_range)
    });
    // f64 beyond f32 would become infinite, and differences of it no numbers.
    let range = node.summary.texel_range;
    let own = |data| (data, node.level, range);
    let (data, data_level, texel_range) = match (node.presence, node.summary.state) {
        (Presence::Absent, _) => (NodeData::Absent, node.level, [0.0; 2]),
        (Presence::Unreadable, _) => inherited,
        (Presence::Present, _) if node.empty => own(NodeData::Empty),
        (Presence::Present, BrickState::Stored) if node.slot == NONE => inherited,
        (Presence::Present, BrickState::Stored) => own(NodeData::Slot(node.slot)),
        (Presence::Present, _) => own(NodeData::Uniform),
    };
    IndexNode {
        parent,
        first_child: NO_NODE,
        data,
        level: node.level,
        data_level,
        texel_range,
        neighbours: [NO_NODE; 6],
    }
}

//! What the window shows, and what keys and the mouse do to it. No window is needed for that.

use super::camera::HandCamera;
use super::transfer::TransferEdit;
use crate::commands::render::middle;
use octree_store::loader::{Camera, ClipBox, TransferFunction, ViewError};
use render_check::transfer::ColorMap;
use render_check::view::{Filter, Look, Mode, NamedView, Shading};

/// What a key does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Act {
    /// The camera turns about its target: radians to the right and up.
    Turn(f64, f64),
    /// What is seen appears so many times as large.
    Zoom(f64),
    /// A camera by name.
    Look(NamedView),
    /// Everything as it was at first.
    Reset,
    /// The next of volume rendering, surface, greatest value.
    NextMode,
    /// The surface's value, by so much of the data's range.
    Isovalue(f64),
    /// Phong's shading on or off.
    Shade,
    /// Blending between levels on or off.
    Blend,
    /// So many times the pixels a voxel may cover.
    Accuracy(f64),
    /// So many times the distance between samples.
    Step(f64),
    /// The transfer function moves by so much of the data's range.
    Shift(f64),
    /// The transfer function becomes so many times as wide.
    Widen(f64),
    /// The transfer function becomes so many times as opaque.
    Strengthen(f64),
    /// The next colour map.
    NextMap,
    /// A face of the clip box moves inwards by so much of the volume's side.
    Clip {
        /// 0 to 2.
        axis: usize,
        /// The face at the axis' high end.
        high: bool,
        /// Share of the side; below 0 outwards.
        inwards: f64,
    },
    /// The whole volume again.
    Unclip,
    /// Figures shown or hidden.
    Figures,
    /// Help shown or hidden.
    Help,
    /// The picture into a file.
    Screenshot,
    /// The end.
    Quit,
}

/// Keys, what they do, and how help tells it. Letters are as they are typed: `X` is Shift and x.
pub(super) const KEYS: [(&[(&str, Act)], &str); 19] = [
    (
        &[
            ("ArrowLeft", Act::Turn(-0.1, 0.0)),
            ("ArrowRight", Act::Turn(0.1, 0.0)),
            ("ArrowUp", Act::Turn(0.0, 0.1)),
            ("ArrowDown", Act::Turn(0.0, -0.1)),
        ],
        "arrows, drag      turn; the right button shifts",
    ),
    (
        &[("+", Act::Zoom(1.2)), ("=", Act::Zoom(1.2)), ("-", Act::Zoom(1.0 / 1.2))],
        "+ -, wheel        nearer, farther",
    ),
    (
        &[
            ("1", Act::Look(NamedView::Axis { axis: 0, from_high: false })),
            ("2", Act::Look(NamedView::Axis { axis: 0, from_high: true })),
            ("3", Act::Look(NamedView::Axis { axis: 1, from_high: false })),
            ("4", Act::Look(NamedView::Axis { axis: 1, from_high: true })),
            ("5", Act::Look(NamedView::Axis { axis: 2, from_high: false })),
            ("6", Act::Look(NamedView::Axis { axis: 2, from_high: true })),
            ("7", Act::Look(NamedView::Oblique(0))),
            ("8", Act::Look(NamedView::Oblique(1))),
            ("9", Act::Look(NamedView::Oblique(2))),
        ],
        "1 to 9            x- x+ y- y+ z- z+ and oblique views",
    ),
    (&[("m", Act::NextMode)], "m                 volume, surface, greatest value"),
    (
        &[("i", Act::Isovalue(0.01)), ("I", Act::Isovalue(-0.01))],
        "i I               surface at a higher, lower value",
    ),
    (&[("g", Act::Shade)], "g                 shading"),
    (
        &[("]", Act::Shift(0.02)), ("[", Act::Shift(-0.02))],
        "] [               transfer function to higher, lower values",
    ),
    (
        &[("}", Act::Widen(1.25)), ("{", Act::Widen(0.8))],
        "} {               transfer function wider, narrower",
    ),
    (
        &[("o", Act::Strengthen(1.25)), ("O", Act::Strengthen(0.8))],
        "o O               more, less opaque",
    ),
    (&[("c", Act::NextMap)], "c                 next colour map"),
    (
        &[("a", Act::Accuracy(0.5)), ("A", Act::Accuracy(2.0))],
        "a A               finer, coarser levels",
    ),
    (&[("s", Act::Step(0.5)), ("S", Act::Step(2.0))], "s S               shorter, longer steps"),
    (&[("b", Act::Blend)], "b                 blending between levels"),
    (
        &[
            ("x", Act::Clip { axis: 0, high: false, inwards: 0.05 }),
            ("X", Act::Clip { axis: 0, high: false, inwards: -0.05 }),
            ("y", Act::Clip { axis: 1, high: false, inwards: 0.05 }),
            ("Y", Act::Clip { axis: 1, high: false, inwards: -0.05 }),
            ("z", Act::Clip { axis: 2, high: false, inwards: 0.05 }),
            ("Z", Act::Clip { axis: 2, high: false, inwards: -0.05 }),
        ],
        "x y z, X Y Z      cut from the low end, and back",
    ),
    (
        &[
            ("j", Act::Clip { axis: 0, high: true, inwards: 0.05 }),
            ("J", Act::Clip { axis: 0, high: true, inwards: -0.05 }),
            ("k", Act::Clip { axis: 1, high: true, inwards: 0.05 }),
            ("K", Act::Clip { axis: 1, high: true, inwards: -0.05 }),
            ("l", Act::Clip { axis: 2, high: true, inwards: 0.05 }),
            ("L", Act::Clip { axis: 2, high: true, inwards: -0.05 }),
        ],
        "j k l, J K L      cut from the high end, and back",
    ),
    (&[("u", Act::Unclip), ("r", Act::Reset)], "u r               uncut; everything as at first"),
    (&[("p", Act::Screenshot)], "p                 picture into a file, when it is whole"),
    (&[("f", Act::Figures), ("h", Act::Help)], "f h               figures; this help"),
    (&[("q", Act::Quit), ("Escape", Act::Quit)], "q, Escape         end"),
];

/// What a key does, if anything.
pub(super) fn act_of(key: &str) -> Option<Act> {
    KEYS.iter()
        .flat_map(|(keys, _)| keys.iter())
        .find(|(name, _)| *name == key)
        .map(|(_, act)| *act)
}

/// A scene as it was opened, and what has been done to it.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    opened: Opened,
    camera: HandCamera,
    edit: TransferEdit,
    look: Look,
    isovalue: f64,
    /// Shares of the volume's sides, from the low to the high end.
    clip: [[f64; 2]; 3],
}

/// What a scene starts with.
#[derive(Debug, Clone)]
pub(super) struct Opened {
    /// Where it is seen from.
    pub(super) camera: Camera,
    /// How it looks.
    pub(super) look: Look,
    /// Least and greatest value of the data.
    pub(super) range: [f64; 2],
    /// Sides of the volume in world units.
    pub(super) size_xyz: [f64; 3],
}

/// The whole volume.
const UNCUT: [[f64; 2]; 3] = [[0.0, 1.0]; 3];
/// The clip box is at least so thick, as a share of the volume's side.
const THINNEST: f64 = 0.01;

impl Scene {
    pub(super) fn new(opened: Opened) -> Self {
        let isovalue = match opened.look.mode {
            Mode::Iso(value) => value,
            _ => middle(&opened.look.transfer, opened.range),
        };
        let share = |world: f64, axis: usize| (world / opened.size_xyz[axis]).clamp(0.0, 1.0);
        let clip = opened.look.clip.map_or(UNCUT, |clip| {
            [0, 1, 2].map(|axis| [share(clip.min()[axis], axis), share(clip.max()[axis], axis)])
        });
        Self {
            camera: HandCamera::new(&opened.camera),
            edit: TransferEdit::default(),
            look: opened.look.clone(),
            isovalue,
            clip,
            opened,
        }
    }

    /// The camera.
    ///
    /// # Errors
    /// When it was moved beyond the numbers.
    pub(super) fn camera(&self) -> Result<Camera, ViewError> {
        self.camera.camera()
    }

    /// A camera instead of the one at hand.
    pub(super) fn look_from(&mut self, camera: &Camera) {
        self.camera = HandCamera::new(camera);
    }

    /// Drags what is seen: shares of the image's height to the right and down. Half a height is a quarter turn.
    pub(super) fn drag(&mut self, to_right: f64, down: f64) {
        let turn = std::f64::consts::PI;
        self.camera.turn(-turn * to_right, turn * down);
    }

    /// Shifts what is seen: shares of the image's height to the right and down.
    pub(super) fn pan(&mut self, to_right: f64, down: f64) {
        self.camera.pan(to_right, -down);
    }

    /// How it looks.
    pub(super) fn look(&self) -> Look {
        let opened = &self.opened;
        let transfer = self.edit.of(&opened.look.transfer, opened.range);
        let window = self.window(&transfer);
        let mode = match self.look.mode {
            Mode::Iso(_) => Mode::Iso(self.isovalue),
            mode => mode,
        };
        Look { mode, transfer, window, clip: self.clip_box(), ..self.look.clone() }
    }

    /// Values that stand for 0 and 1. Those of the greatest value are changed as a transfer function is.
    fn window(&self, transfer: &TransferFunction) -> [f64; 2] {
        let opened = &self.opened;
        if let Mode::Mip = self.look.mode {
            let ends =
                if opened.look.mode == Mode::Mip { opened.look.window } else { opened.range };
            let window = ends.map(|end| self.edit.moved(end, ends, opened.range));
            if window[0] < window[1] { window } else { opened.look.window }
        } else {
            Look::new(transfer.clone(), opened.range).window
        }
    }

    fn clip_box(&self) -> Option<ClipBox> {
        if self.clip == UNCUT {
            return None;
        }
        let size = self.opened.size_xyz;
        let end = |high: usize| [0, 1, 2].map(|axis| self.clip[axis][high] * size[axis]);
        ClipBox::new(end(0), end(1)).ok()
    }

    /// Does what a key says. Whether the picture changes; what is not the scene's is left to the window.
    pub(super) fn act(&mut self, act: Act) -> bool {
        let bounded = |value: f64, factor: f64, limits: [f64; 2]| {
            (value * factor).clamp(limits[0], limits[1])
        };
        match act {
            Act::Turn(to_right, to_top) => self.camera.turn(to_right, to_top),
            Act::Zoom(factor) => self.camera.zoom(factor),
            Act::Reset => *self = Self::new(self.opened.clone()),
            Act::NextMode => {
                self.look.mode = match self.look.mode {
                    Mode::Dvr => Mode::Iso(self.isovalue),
                    Mode::Iso(_) => Mode::Mip,
                    Mode::Mip => Mode::Dvr,
                };
                self.look.shading = matches!(self.look.mode, Mode::Iso(_)).then(Shading::default);
            }
            Act::Isovalue(by) => {
                let [low, high] = self.opened.range;
                self.isovalue = (self.isovalue + by * (high - low)).clamp(low, high);
            }
            Act::Shade => {
                self.look.shading = match self.look.shading {
                    None => Some(self.opened.look.shading.unwrap_or_default()),
                    Some(_) => None,
                };
            }
            Act::Blend => {
                self.look.filter = match self.look.filter {
                    Filter::Trilinear => Filter::Quadrilinear,
                    Filter::Quadrilinear => Filter::Trilinear,
                };
            }
            Act::Accuracy(factor) => {
                self.look.accuracy = bounded(self.look.accuracy, factor, [1.0 / 16.0, 256.0]);
            }
            Act::Step(factor) => {
                self.look.step_voxels = bounded(self.look.step_voxels, factor, [1.0 / 16.0, 16.0]);
            }
            Act::Shift(by) => self.edit.shift += by,
            Act::Widen(factor) => self.edit.width = bounded(self.edit.width, factor, [1e-3, 1e3]),
            Act::Strengthen(factor) => {
                self.edit.gain = bounded(self.edit.gain, factor, [1e-6, 1e6]);
            }
            Act::NextMap => {
                let next = self.edit.map.map_or(0, |at| at + 1);
                self.edit.map = (next < ColorMap::all().count()).then_some(next);
            }
            Act::Clip { axis, high, inwards } => {
                let [low_end, high_end] = &mut self.clip[axis];
                if high {
                    *high_end = (*high_end - inwards).min(1.0).max(*low_end + THINNEST);
                } else {
                    *low_end = (*low_end + inwards).max(0.0).min(*high_end - THINNEST);
                }
            }
            Act::Unclip => self.clip = UNCUT,
            Act::Look(_) | Act::Figures | Act::Help | Act::Screenshot | Act::Quit => return false,
        }
        true
    }

    /// The name of the colour map at hand, if one replaces the function's own colours.
    pub(super) fn map_name(&self) -> Option<&'static str> {
        self.edit.map.and_then(|at| ColorMap::all().nth(at)).map(ColorMap::name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use octree_store::loader::{CameraJson, ControlPoint};
    use std::collections::HashSet;

    fn scene() -> Scene {
        let point = |value, extinction| ControlPoint { value, color: [0.5; 3], extinction };
        let transfer = TransferFunction::new(vec![point(100.0, 0.0), point(300.0, 1.0)]).unwrap();
        let range = [0.0, 1000.0];
        let camera = CameraJson::Orthographic {
            position: [0.0, 0.0, -10.0],
            target: [0.0; 3],
            up: [0.0, -1.0, 0.0],
            height: 20.0,
        };
        Scene::new(Opened {
            camera: Camera::new(camera).unwrap(),
            look: Look::new(transfer, range),
            range,
            size_xyz: [10.0, 20.0, 40.0],
        })
    }

    #[test]
    fn every_key_is_its_own_and_changes_what_it_says() {
        let keys: Vec<&str> =
            KEYS.iter().flat_map(|(keys, _)| keys.iter()).map(|(key, _)| *key).collect();
        assert_eq!(keys.len(), keys.iter().collect::<HashSet<_>>().len());
        for (key, act) in KEYS.iter().flat_map(|(keys, _)| keys.iter()) {
            let mut scene = scene();
            // Somewhere between the ends of everything.
            for (axis, high) in
                [(0, false), (0, true), (1, false), (1, true), (2, false), (2, true)]
            {
                scene.act(Act::Clip { axis, high, inwards: 0.2 });
            }
            scene.act(Act::Turn(0.3, 0.2));
            scene.act(Act::NextMode);
            let before = (scene.camera().unwrap(), scene.look(), scene.edit);
            let changes = scene.act(act_of(key).unwrap());
            let after = (scene.camera().unwrap(), scene.look(), scene.edit);
            assert_eq!(changes, before != after, "{key}: {act:?}");
        }
        assert_eq!(act_of("Tab"), None);
    }

    #[test]
    fn whatever_is_done_leaves_a_look_that_can_be_drawn() {
        let acts: Vec<Act> =
            KEYS.iter().flat_map(|(keys, _)| keys.iter()).map(|(_, a)| *a).collect();
        for first in &acts {
            for second in &acts {
                let mut scene = scene();
                for _ in 0..60 {
                    scene.act(*first);
                    scene.act(*second);
                    scene.act(*second);
                }
                let look = scene.look();
                look.check().unwrap();
                assert!(look.window[0] < look.window[1], "{first:?} {second:?}");
                scene.camera().unwrap();
                scene.act(Act::Reset);
                assert_eq!(scene.look(), scene.opened.look);
                assert_eq!(scene.camera().unwrap(), scene.opened.camera);
            }
        }
    }

    #[test]
    fn the_clip_box_is_in_world_units_and_never_empty() {
        let mut scene = scene();
        scene.act(Act::Clip { axis: 1, high: false, inwards: 0.25 });
        scene.act(Act::Clip { axis: 2, high: true, inwards: 0.5 });
        let clip = scene.look().clip.unwrap();
        assert_eq!((clip.min(), clip.max()), ([0.0, 5.0, 0.0], [10.0, 20.0, 20.0]));
        for _ in 0..99 {
            scene.act(Act::Clip { axis: 1, high: false, inwards: 0.05 });
            scene.act(Act::Clip { axis: 1, high: true, inwards: 0.05 });
        }
        let clip = scene.look().clip.unwrap();
        assert!(clip.max()[1] - clip.min()[1] > 0.1, "{clip:?}");
        scene.act(Act::Unclip);
        assert_eq!(scene.look().clip, None);
    }

    #[test]
    fn modes_go_round_and_keep_the_surface() {
        let mut scene = scene();
        scene.act(Act::NextMode);
        scene.act(Act::Isovalue(0.1));
        assert_eq!(scene.look().mode, Mode::Iso(600.0));
        assert!(scene.look().shading.is_some());
        scene.act(Act::NextMode);
        assert_eq!((scene.look().mode, scene.look().window), (Mode::Mip, [0.0, 1000.0]));
        scene.act(Act::Shift(0.02));
        assert_eq!(scene.look().window, [20.0, 1020.0]);
        scene.act(Act::NextMode);
        assert_eq!(scene.look().mode, Mode::Dvr);
        assert_eq!(scene.look().window, [120.0, 320.0]);
    }
}

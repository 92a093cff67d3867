//! Camera paths by formula, for a volume of any size: what a user does, sixty frames a second.

use octree_store::loader::{
    Appearance, Camera, CameraJson, ControlPoint, TransferFunction, View, ViewError,
};

/// One way to look at a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Path {
    /// Once around in 360 frames.
    Orbit,
    /// In from outside, through the middle and out, in 240 frames.
    FlyThrough,
    /// From the whole volume to a hundredth of it, in 240 frames.
    Zoom,
    /// Standing still while the threshold of the transfer function goes up and down, in 120 frames.
    TransferCut,
    /// To the other side at once, every 60 frames.
    Jump,
}

impl Path {
    pub(crate) const ALL: [Self; 5] =
        [Self::Orbit, Self::FlyThrough, Self::Zoom, Self::TransferCut, Self::Jump];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Orbit => "orbit",
            Self::FlyThrough => "fly-through",
            Self::Zoom => "zoom",
            Self::TransferCut => "transfer function",
            Self::Jump => "jump",
        }
    }

    pub(crate) fn frames(self) -> u32 {
        match self {
            Self::Orbit => 360,
            Self::FlyThrough | Self::Zoom | Self::Jump => 240,
            Self::TransferCut => 120,
        }
    }

    /// The view of a frame, in a volume `side` world units wide.
    pub(crate) fn view(self, frame: u32, side: f64, size: [u32; 2]) -> Result<View, ViewError> {
        let t = f64::from(frame) / f64::from(self.frames());
        let around = |turns: f64, radius: f64| {
            let a = turns * std::f64::consts::TAU + 0.4;
            [0.5 + radius * a.cos(), 0.42, 0.5 + radius * a.sin()]
        };
        let middle = [0.5, 0.5, 0.5];
        let (position, target) = match self {
            Self::Orbit => (around(t, 1.3), middle),
            Self::FlyThrough => {
                let z = -0.5 + 2.0 * t;
                ([0.5 + 0.1 * (6.0 * t).sin(), 0.45, z], [0.5, 0.5, z + 0.3])
            }
            Self::Zoom => (around(0.1, 1.3 * 0.01_f64.powf(t) + 0.31), around(0.1, 0.3)),
            Self::TransferCut => (around(0.0, 1.3), middle),
            Self::Jump => (around(f64::from(frame / 60) * 0.5, 1.3), middle),
        };
        look(position.map(|c| c * side), target.map(|c| c * side), size)
    }

    /// The threshold of a frame, as a share of the usual one.
    pub(crate) fn threshold(self, frame: u32) -> f64 {
        let t = f64::from(frame) / f64::from(self.frames());
        if self == Self::TransferCut { 1.0 + (t * std::f64::consts::TAU).sin() } else { 1.0 }
    }
}

pub(crate) fn look(
    position: [f64; 3],
    target: [f64; 3],
    size: [u32; 2],
) -> Result<View, ViewError> {
    let up = [0.0, -1.0, 0.0];
    let fov_y_deg = 40.0;
    View::new(Camera::new(CameraJson::Perspective { position, target, up, fov_y_deg })?, size)
}

/// Nothing below the threshold; above it, a ray through `depth` of the volume's side is left with 1/e.
pub(crate) fn appearance(threshold: f64, side: f64, depth: f64) -> anyhow::Result<Appearance> {
    let extinction = 1.0 / (depth * side);
    let point = |value, extinction| ControlPoint { value, color: [1.0, 0.9, 0.8], extinction };
    let points = vec![
        point(threshold, 0.0),
        point(threshold + 4000.0, extinction),
        point(threshold + 30_000.0, 2.0 * extinction),
    ];
    Ok(Appearance::Transfer(TransferFunction::new(points)?))
}

/// Values of the phantom's and the simulation's air lie below this, those of its bodies above.
pub(crate) const THRESHOLD: f64 = 14_000.0;
/// Nearly opaque walls, and walls that much shines through.
pub(crate) const OPAQUE: f64 = 0.003;
pub(crate) const TRANSPARENT: f64 = 0.03;

//! The cut for a view: which bricks a client needs, and those that it lacks, coarse to fine.

use super::asked::Path;
use super::bricks::Form;
use super::read_json;
use crate::app::App;
use crate::frames::{Kind, frame, nodes_of, stream_of};
use crate::problem::Problem;
use axum::body::Body;
use axum::extract::State;
use axum::response::Response;
use octree_store::Store;
use octree_store::loader::{
    Appearance, Camera, ClipBox, Cut, LeafKind, Quality, Scene, StoreNodes, TransferFunction, View,
    select_cut,
};
use serde::Deserialize;
use std::collections::HashSet;
use std::sync::Arc;

/// Cameras of one request, at most.
const CAMERA_LIMIT: usize = 64;

/// Bricks of one cut, at most.
const BUDGET_LIMIT: usize = 65_536;

/// What a client wants to see.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    cameras: Vec<Camera>,
    size: [u32; 2],
    #[serde(default = "one")]
    accuracy: f64,
    transfer: Option<TransferFunction>,
    isovalue: Option<f64>,
    clip: Option<ClipBox>,
    #[serde(default = "default_budget")]
    budget_bricks: usize,
    #[serde(default)]
    have: Vec<[u64; 4]>,
    #[serde(default = "stored")]
    form: Form,
}

fn one() -> f64 {
    1.0
}

fn default_budget() -> usize {
    4096
}

fn stored() -> Form {
    Form::Stored
}

impl Wanted {
    fn appearance(&self) -> Result<Appearance, Problem> {
        match (&self.transfer, self.isovalue) {
            (Some(_), Some(_)) => Err(Problem::malformed("give transfer or isovalue, not both")),
            (Some(transfer), None) => Ok(Appearance::Transfer(transfer.clone())),
            (None, Some(value)) => Ok(Appearance::Isovalue(value)),
            (None, None) => Ok(Appearance::Everything),
        }
    }

    fn views(&self) -> Result<Vec<View>, Problem> {
        if self.cameras.is_empty() || self.cameras.len() > CAMERA_LIMIT {
            let detail = format!("{} cameras: give 1 to {CAMERA_LIMIT}", self.cameras.len());
            return Err(Problem::malformed(detail));
        }
        if !self.accuracy.is_finite() || self.accuracy <= 0.0 {
            return Err(Problem::malformed("accuracy, in pixels a voxel, must be above 0"));
        }
        if !(1..=BUDGET_LIMIT).contains(&self.budget_bricks) {
            let detail = format!("budget_bricks must be 1 to {BUDGET_LIMIT}");
            return Err(Problem::malformed(detail));
        }
        let view = |camera: &Camera| {
            View::new(camera.clone(), self.size).map_err(|e| Problem::malformed(e.to_string()))
        };
        self.cameras.iter().map(view).collect()
    }
}

pub(super) async fn cut(
    State(app): State<Arc<App>>,
    Path(name): Path<String>,
    body: Body,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let wanted: Wanted = read_json(&app, body).await?;
    let (views, appearance) = (wanted.views()?, wanted.appearance()?);
    // What the dataset has not, the client cannot have.
    let have: HashSet<_> =
        nodes_of(&app, &named.dataset, &wanted.have)?.into_iter().flatten().collect();
    let quality = Quality { accuracy: wanted.accuracy, ..Quality::default() };
    let (clip, budget) = (wanted.clip, wanted.budget_bricks);
    let select = move |store: &Store| {
        let scene = Scene { views: &views, clip, appearance: &appearance, quality };
        select_cut(&mut StoreNodes::new(store), &scene, budget)
    };
    let cut = app.read(&named.dataset, select).await?;
    let lacking = cut.lacking(&have).map(|leaf| Some(leaf.key)).collect();
    stream_of(&app, &named.dataset, vec![leaves_frame(&cut, &have)], lacking, wanted.form.into())
}

/// The list of a cut's leaves: 16 bytes each (docs/HTTP.md, "Cut").
fn leaves_frame(cut: &Cut, have: &HashSet<octree_store::NodeKey>) -> bytes::Bytes {
    let mut body = Vec::with_capacity(16 * cut.leaves.len());
    for leaf in &cut.leaves {
        let kind = match leaf.kind {
            LeafKind::Brick => 1,
            LeafKind::Uniform => 2,
            LeafKind::Empty => 3,
            LeafKind::OutOfView => 4,
            LeafKind::Damaged => 5,
        };
        body.extend_from_slice(&leaf.key.to_u64().to_le_bytes());
        body.extend_from_slice(&[kind, u8::from(have.contains(&leaf.key)), 0, 0]);
        body.extend_from_slice(&leaf.voxel_pixels.to_le_bytes());
    }
    let flags = f64::from(u8::from(cut.limited));
    frame(Kind::Leaves, u64::MAX, [cut.leaves.len() as f64, flags], 0, &body)
}

//! One brick.

use super::asked::{Path, Query};
use super::{RECORD, STATE, VALUE_MAP};
use crate::answer::{Answer, Conditions};
use crate::app::{App, key_of};
use crate::dataset::Named;
use crate::problem::Problem;
use crate::product::Shape;
use axum::extract::State;
use axum::response::Response;
use octree_store::{NodeKey, UploadFormat};
use serde::Deserialize;
use std::fmt::Write;
use std::sync::Arc;

/// How a brick is wanted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Form {
    /// Decoded.
    #[default]
    Samples,
    /// As it is stored.
    Stored,
    /// As a texture takes it.
    Codes,
}

impl From<Form> for Shape {
    fn from(form: Form) -> Self {
        match form {
            Form::Samples => Self::Samples,
            Form::Stored => Self::Stored,
            Form::Codes => Self::Codes,
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    #[serde(default)]
    form: Form,
}

/// Dataset, level, and the brick's x, y and z.
type Place = (String, u64, u64, u64, u64);

pub(super) async fn brick(
    State(app): State<Arc<App>>,
    Path((name, level, x, y, z)): Path<Place>,
    Query(Wanted { form }): Query<Wanted>,
    conditions: Conditions,
) -> Result<Response, Problem> {
    let named = app.catalog.find(&name)?;
    let key = key_of(&named.dataset, [level, x, y, z]).ok_or_else(|| {
        Problem::absent(format!("the dataset has no level {level} brick {x},{y},{z}"))
    })?;
    brick_answer(&app, &named, key, form.into(), &conditions, |answer| answer).await
}

/// A brick in a shape, to one who stated these conditions. Who has it already hears so before anything is read.
pub(super) async fn brick_answer(
    app: &Arc<App>,
    named: &Named,
    key: NodeKey,
    shape: Shape,
    conditions: &Conditions,
    extra: impl FnOnce(Answer) -> Answer,
) -> Result<Response, Problem> {
    let etag = named.dataset.etag(key, shape);
    if conditions.has(&etag) {
        return Ok(Answer::binary(bytes::Bytes::new(), etag, named.lifetime()).not_modified());
    }
    let product = app.product(&named.dataset, key, shape).await?;
    let mut answer = Answer::binary(product.bytes, etag, named.lifetime());
    if matches!(shape, Shape::Samples | Shape::Stored | Shape::Codes) {
        let mut record = String::new();
        for byte in product.record.to_bytes() {
            let _ = write!(record, "{byte:02x}");
        }
        answer = answer.with(STATE, product.record.state.name()).with(RECORD, &record);
    }
    if let Some(map) = product.map {
        let format = match map.format {
            UploadFormat::R8 => "r8",
            UploadFormat::R16 => "r16",
            UploadFormat::R32Float => "r32float",
        };
        let text = format!("format={format}; scale={:?}; offset={:?}", map.scale, map.offset);
        answer = answer.with(VALUE_MAP, &text);
    }
    Ok(extra(answer).to(conditions))
}

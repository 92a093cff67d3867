//! Gradients by central differences, and Blinn and Phong's model on them.
//!
//! Twin of `shade.wgsl`. Where the gradient is no more than noise there is no normal: shading fades away with it.

use super::ray::Ray;
use super::sample::{Leaf, value_of, voxel_of};
use super::trace::Scene;
use glam::Vec3;

/// Gradients, in windows a voxel, of which half is believed.
const FAINT: f32 = 0.01;

/// What light makes of a colour: a factor, and a white highlight.
pub(super) fn light_at(scene: &Scene, leaf: &Leaf, ray: &Ray, at: Vec3, level: f32) -> [f32; 2] {
    let h = voxel_of(leaf);
    let value = |offset: Vec3| value_of(scene, leaf, at + h * offset, level);
    let difference = Vec3::new(
        value(Vec3::X) - value(Vec3::NEG_X),
        value(Vec3::Y) - value(Vec3::NEG_Y),
        value(Vec3::Z) - value(Vec3::NEG_Z),
    );
    let spacing = Vec3::from_array(scene.frame.spacing);
    let finest = spacing.x.min(spacing.y).min(spacing.z);
    let gradient = difference / (2.0 * h) * (finest / spacing);
    let square = gradient.dot(gradient);
    let trust = square / (square + FAINT * FAINT);
    let normal = gradient / square.max(1e-20).sqrt();
    let light = Vec3::from_array(scene.frame.light);
    let towards = if light.dot(light) > 0.0 { light } else { -ray.direction };
    let between = towards - ray.direction;
    let half_way = between / between.dot(between).max(1e-20).sqrt();
    let diffuse = normal.dot(towards).abs();
    let highlight = normal.dot(half_way).abs().max(1e-6).powf(scene.frame.shininess);
    let factor = scene.frame.ambient + scene.frame.diffuse * diffuse;
    [1.0 + (factor - 1.0) * trust, scene.frame.specular * highlight * trust]
}

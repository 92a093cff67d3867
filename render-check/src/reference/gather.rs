//! What a segment adds, in f64.

use super::{Gathered, Tracer, at};
use crate::transfer::decay;
use crate::view::{PixelRay, Shading};
use glam::DVec3;

impl Tracer<'_> {
    /// Light and extinction of a segment between two indices, whose values are assumed to be linear between.
    pub(super) fn add_light(
        &self,
        ray: &PixelRay,
        [from, to]: [f64; 2],
        [first, second]: [f64; 2],
        gathered: &mut Gathered,
    ) {
        let [r, g, b, extinction] = self.integrals.mean(first, second);
        if extinction <= 0.0 {
            return;
        }
        let length = (to - from) * ray.world_per_index;
        let (left, share) = decay(extinction * length);
        let mut light = DVec3::new(r, g, b);
        if let Some(shading) = &self.look.shading {
            let middle = at(ray, f64::midpoint(from, to));
            let (factor, highlight) = self.light_at(ray, middle, shading);
            light = light * factor + DVec3::splat(extinction * highlight);
        }
        gathered.color += gathered.left * length * share * light;
        let taken = gathered.left * length * share * extinction;
        if gathered.alpha < 0.5 && gathered.alpha + taken >= 0.5 {
            let t = (0.5 - gathered.alpha) / taken;
            gathered.depth = distance(ray, from + t * (to - from));
        }
        gathered.alpha += taken;
        gathered.left *= left;
    }

    /// The surface, if the values of a segment's ends enclose it: by halving, to the last bit.
    pub(super) fn find_surface(
        &self,
        ray: &PixelRay,
        [from, to]: [f64; 2],
        [first, second]: [f64; 2],
        surface: f64,
        gathered: &mut Gathered,
    ) {
        let below = first - surface;
        if below * (second - surface) > 0.0 || first == second {
            return;
        }
        let (mut low, mut high) = (from, to);
        for _ in 0..52 {
            let middle = f64::midpoint(low, high);
            if (self.value(at(ray, middle)) - surface) * below <= 0.0 {
                high = middle;
            } else {
                low = middle;
            }
        }
        let index = f64::midpoint(low, high);
        let mut color = DVec3::from_array(self.look.surface_color);
        if let Some(shading) = &self.look.shading {
            let (factor, highlight) = self.light_at(ray, at(ray, index), shading);
            color = color * factor + DVec3::splat(highlight);
        }
        *gathered = Gathered {
            color,
            left: 0.0,
            alpha: 1.0,
            depth: distance(ray, index),
            best: gathered.best,
        };
    }

    /// Blinn and Phong's model: a factor for a colour, and a white highlight. See `ray/shade.rs`.
    fn light_at(&self, ray: &PixelRay, middle: DVec3, shading: &Shading) -> (f64, f64) {
        const FAINT: f64 = 0.01;
        let value = |offset: DVec3| self.look.normalised(self.value(middle + offset));
        let difference = DVec3::new(
            value(DVec3::X) - value(DVec3::NEG_X),
            value(DVec3::Y) - value(DVec3::NEG_Y),
            value(DVec3::Z) - value(DVec3::NEG_Z),
        );
        let spacing = self.grid.spacing;
        let gradient = difference / 2.0 * (spacing.min_element() / spacing);
        let square = gradient.length_squared();
        let trust = square / (square + FAINT * FAINT);
        let normal = gradient.normalize_or_zero();
        let towards = shading
            .light
            .map_or(-ray.direction, |light| DVec3::from_array(light).normalize_or_zero());
        let half_way = (towards - ray.direction).normalize_or_zero();
        let diffuse = normal.dot(towards).abs();
        let highlight = normal.dot(half_way).abs().max(1e-6).powf(shading.shininess);
        let factor = shading.ambient + shading.diffuse * diffuse;
        (1.0 + (factor - 1.0) * trust, shading.specular * highlight * trust)
    }
}

pub(super) fn take_greater(ray: &PixelRay, index: f64, value: f64, gathered: &mut Gathered) {
    if value > gathered.best {
        gathered.best = value;
        gathered.depth = distance(ray, index);
    }
}

/// The world distance of an index from the eye.
fn distance(ray: &PixelRay, index: f64) -> f64 {
    ray.world_before + index * ray.world_per_index
}

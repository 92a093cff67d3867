//! The shader's text, and how it is compiled.

use crate::ray::Variant;
use serde::{Deserialize, Serialize};

/// All files of the shader, one after the other.
pub const SHADER: &str = concat!(
    include_str!("../ray/frame.wgsl"),
    include_str!("../ray/node.wgsl"),
    include_str!("../ray/fixed.wgsl"),
    include_str!("../ray/ray.wgsl"),
    include_str!("../ray/walk.wgsl"),
    include_str!("../ray/sample.wgsl"),
    include_str!("../ray/transfer.wgsl"),
    include_str!("../ray/shade.wgsl"),
    include_str!("../ray/gather.wgsl"),
    include_str!("../ray/trace.wgsl"),
);

/// Who interpolates between texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sampling {
    /// The shader, in f32: exact.
    Manual,
    /// The texture unit: fast, with about eight bits of weight on most devices.
    #[default]
    Hardware,
}

/// Values of the shader's override constants; `resumed` rays go on from their states.
pub(super) fn constants(
    variant: Variant,
    resumed: bool,
    sampling: Sampling,
) -> [(&'static str, f64); 5] {
    let flag = |set: bool| f64::from(u8::from(set));
    [
        ("MODE", f64::from(variant.mode)),
        ("SHADED", flag(variant.shaded)),
        ("BLENDED", flag(variant.blended)),
        ("RESUMED", flag(resumed)),
        ("HARDWARE", flag(sampling == Sampling::Hardware)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ray::{Frame, RayNode};
    use std::mem::{offset_of, size_of};
    use wgpu::naga;
    use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};

    fn module() -> naga::Module {
        let module = naga::front::wgsl::parse_str(SHADER);
        module.unwrap_or_else(|error| panic!("{}", error.emit_to_string(SHADER)))
    }

    #[test]
    fn the_shader_is_valid_without_any_driver() {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        if let Err(error) = validator.validate(&module()) {
            panic!("{}", error.emit_to_string(SHADER));
        }
    }

    /// Names, offsets and size of a struct as the shader sees it.
    fn layout(name: &str) -> (Vec<(String, usize)>, usize) {
        let module = module();
        let (_, found) =
            module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name}") };
        let place = |m: &naga::StructMember| (m.name.clone().unwrap(), m.offset as usize);
        (members.iter().map(place).collect(), *span as usize)
    }

    macro_rules! offsets {
        ($type:ty, $($field:ident),+) => {
            vec![$((stringify!($field).to_owned(), offset_of!($type, $field))),+]
        };
    }

    #[test]
    fn structs_lie_in_memory_as_the_shader_reads_them() {
        let (members, size) = layout("Frame");
        let expected = offsets!(
            Frame,
            origin_cell,
            step_voxels,
            origin_frac,
            plane,
            origin_across,
            blend_offset,
            origin_down,
            blend_slope,
            direction,
            isovalue,
            direction_across,
            ambient,
            direction_down,
            diffuse,
            spacing,
            specular,
            clip_min_cell,
            shininess,
            clip_min_frac,
            overlap,
            clip_max_cell,
            side,
            clip_max_frac,
            last_entry,
            dims,
            core,
            light,
            budget,
            surface,
            first_row,
            size,
            pool,
            texel
        );
        assert_eq!(members, expected);
        assert_eq!(size, size_of::<Frame>());
        // Nodes are read as four texels of 16 bytes: the struct is the first two, and the others are taken by number.
        let (members, size) = layout("Node");
        assert_eq!(members, offsets!(RayNode, brick, levels, values, slot, parent));
        assert_eq!(size, 32);
        assert_eq!(offset_of!(RayNode, first_child), 2 * 16);
        assert_eq!(offset_of!(RayNode, neighbours), 2 * 16 + 4);
        assert_eq!(size_of::<RayNode>(), 4 * 16);
        assert_eq!(layout("State").1 as u64, super::super::buffers::STATE_BYTES);
    }
}

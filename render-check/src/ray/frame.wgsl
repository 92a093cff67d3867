// What all rays of a picture share, and what is bound. Twin of frame.rs.

struct Frame {
    origin_cell: vec3<i32>,
    step_voxels: f32,
    origin_frac: vec3<f32>,
    plane: f32,
    origin_across: vec3<f32>,
    blend_offset: f32,
    origin_down: vec3<f32>,
    blend_slope: f32,
    direction: vec3<f32>,
    isovalue: f32,
    direction_across: vec3<f32>,
    ambient: f32,
    direction_down: vec3<f32>,
    diffuse: f32,
    spacing: vec3<f32>,
    specular: f32,
    clip_min_cell: vec3<i32>,
    shininess: f32,
    clip_min_frac: vec3<f32>,
    overlap: f32,
    clip_max_cell: vec3<i32>,
    side: f32,
    clip_max_frac: vec3<f32>,
    last_entry: f32,
    dims: vec3<i32>,
    core: i32,
    light: vec3<f32>,
    budget: i32,
    surface: vec3<f32>,
    first_row: u32,
    size: vec2<u32>,
    pool: vec2<u32>,
    texel: vec3<f32>,
}

override MODE: u32 = 0u;
override SHADED: bool = false;
override BLENDED: bool = false;
override HARDWARE: bool = false;
// Rays go on from their states. No branch depends on the uniform block alone: Mesa's software driver would put its values into the
// shader, compile that anew for every dispatch, and keep it for ever.
override RESUMED: bool = false;

const DVR: u32 = 0u;
const ISO: u32 = 1u;
const MIP: u32 = 2u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var nodes: texture_2d<u32>;
@group(0) @binding(2) var bricks: texture_3d<f32>;
@group(0) @binding(3) var linear_sampler: sampler;
@group(0) @binding(4) var table: texture_2d<f32>;
@group(0) @binding(5) var<storage, read_write> seen: array<atomic<u32>>;
@group(0) @binding(6) var<storage, read_write> colors: array<vec4<f32>>;
// In: where rays end, as a distance from the eye. Out: where they were half opaque.
@group(0) @binding(7) var<storage, read_write> depths: array<f32>;
@group(0) @binding(8) var<storage, read_write> states: array<State>;
@group(0) @binding(9) var<storage, read_write> unfinished: atomic<u32>;

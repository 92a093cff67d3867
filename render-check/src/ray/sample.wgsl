// Values within bricks and between levels. Twin of sample.rs.

struct Data {
    slot: u32,
    corner: vec3<i32>,
    level: u32,
    values: vec2<f32>,
    texel: vec3<i32>,
    scale: f32,
}

struct Leaf {
    own: Data,
    up: Data,
    top: Data,
}

fn data_of(node: Node) -> Data {
    let level = data_level_of(node);
    let scale = 1.0 / f32(1u << level);
    return Data(node.slot, data_corner_of(node), level, node.values, texel_corner(node.slot), scale);
}

fn above(node: Node, own: Data) -> Data {
    if node.parent == NO_NODE {
        return own;
    }
    let parent = node_at(node.parent);
    if parent.slot == HIDDEN {
        return own;
    }
    return data_of(parent);
}

fn leaf_of(node: Node) -> Leaf {
    let own = data_of(node);
    if !BLENDED || node.parent == NO_NODE {
        return Leaf(own, own, own);
    }
    let up = above(node, own);
    return Leaf(own, up, above(node_at(node.parent), up));
}

fn voxel_of(leaf: Leaf) -> f32 {
    return f32(1u << leaf.own.level);
}

fn right_level(ray: Ray, station: Station) -> f32 {
    let depth = ray.depth + (f32(station.index) + station.part) * ray.depth_step;
    return log2(max(frame.blend_offset + frame.blend_slope * depth, 1e-30));
}

fn texel_corner(slot: u32) -> vec3<i32> {
    let row = slot / frame.pool.x;
    let z = row / frame.pool.y;
    return vec3<i32>(vec3(slot - row * frame.pool.x, row - z * frame.pool.y, z) * u32(frame.side));
}

fn texel(at: vec3<i32>, x: i32, y: i32, z: i32) -> f32 {
    return textureLoad(bricks, at + vec3(x, y, z), 0).x;
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    return a + (b - a) * t;
}

fn texels(data: Data, at: vec3<f32>) -> f32 {
    if HARDWARE {
        let uvw = (vec3<f32>(data.texel) + at + 0.5) * frame.texel;
        return textureSampleLevel(bricks, linear_sampler, uvw, 0.0).x;
    }
    let last = frame.side - 1.0;
    let below = min(floor(at), vec3(last - 1.0));
    let t = at - below;
    let i = vec3<i32>(below) + data.texel;
    let x00 = lerp(texel(i, 0, 0, 0), texel(i, 1, 0, 0), t.x);
    let x10 = lerp(texel(i, 0, 1, 0), texel(i, 1, 1, 0), t.x);
    let x01 = lerp(texel(i, 0, 0, 1), texel(i, 1, 0, 1), t.x);
    let x11 = lerp(texel(i, 0, 1, 1), texel(i, 1, 1, 1), t.x);
    return lerp(lerp(x00, x10, t.y), lerp(x01, x11, t.y), t.z);
}

fn sample(data: Data, at: vec3<f32>) -> f32 {
    if data.slot == UNIFORM {
        return data.values.x;
    }
    let scaled = at * data.scale + (frame.overlap - 0.5);
    let found = texels(data, clamp(scaled, vec3(0.0), vec3(frame.side - 1.0)));
    return data.values.x + found * (data.values.y - data.values.x);
}

fn value_of(leaf: Leaf, at: vec3<f32>, level: f32) -> f32 {
    let finer = sample(leaf.own, at);
    let beyond = level - f32(leaf.own.level);
    if !BLENDED || beyond <= 0.0 {
        return finer;
    }
    let at_up = at + vec3<f32>(leaf.own.corner - leaf.up.corner);
    let coarser = sample(leaf.up, at_up);
    if beyond <= 1.0 {
        return finer + (coarser - finer) * beyond;
    }
    let at_top = at + vec3<f32>(leaf.own.corner - leaf.top.corner);
    let coarsest = sample(leaf.top, at_top);
    return coarser + (coarsest - coarser) * min(beyond - 1.0, 1.0);
}

// The spatial index as rays read it. Twin of node.rs.

const NO_NODE: u32 = 0xffffffffu;
const HIDDEN: u32 = 0xffffffffu;
const UNIFORM: u32 = 0xfffffffeu;

// The first half of a node's 64 bytes. The other half is the first child and the neighbours at -x, +x, -y, +y, -z, +z.
struct Node {
    brick: vec3<i32>,
    levels: u32,
    values: vec2<f32>,
    slot: u32,
    parent: u32,
}

// A node is four texels, and 256 nodes are a line.
fn quarter(at: u32, which: u32) -> vec4<u32> {
    return textureLoad(nodes, vec2(4u * (at & 255u) + which, at >> 8u), 0);
}

fn node_at(at: u32) -> Node {
    let a = quarter(at, 0u);
    let b = quarter(at, 1u);
    return Node(bitcast<vec3<i32>>(a.xyz), a.w, bitcast<vec2<f32>>(b.xy), b.z, b.w);
}

fn first_child_of(at: u32) -> u32 {
    return quarter(at, 2u).x;
}

fn neighbour_of(at: u32, face: u32) -> u32 {
    return quarter(at, 2u + (face + 1u) / 4u)[(face + 1u) & 3u];
}

fn level_of(node: Node) -> u32 {
    return node.levels & 0xffu;
}

fn data_level_of(node: Node) -> u32 {
    return node.levels >> 8u;
}

fn size_of(node: Node) -> i32 {
    return frame.core << level_of(node);
}

fn corner_of(node: Node) -> vec3<i32> {
    return node.brick * size_of(node);
}

fn data_corner_of(node: Node) -> vec3<i32> {
    let up = data_level_of(node) - level_of(node);
    return (node.brick >> vec3(up)) * (frame.core << data_level_of(node));
}

// Where a node lies: its corner in voxels, and the side in w.
fn cube_at(at: u32) -> vec4<i32> {
    let a = quarter(at, 0u);
    let size = frame.core << (a.w & 0xffu);
    return vec4(bitcast<vec3<i32>>(a.xyz) * size, size);
}

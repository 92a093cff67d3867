// The spatial index as rays read it. Twin of node.rs.

const NO_NODE: u32 = 0xffffffffu;
const HIDDEN: u32 = 0xffffffffu;
const UNIFORM: u32 = 0xfffffffeu;

struct Node {
    brick: vec3<i32>,
    levels: u32,
    values: vec2<f32>,
    slot: u32,
    parent: u32,
    first_child: u32,
    neighbours: array<u32, 6>,
    padding: u32,
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

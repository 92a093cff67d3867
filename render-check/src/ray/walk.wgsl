// From leaf to leaf by neighbour pointers. Twin of walk.rs.

fn descend(origin: u32, cell: vec3<i32>) -> u32 {
    var at = origin;
    while nodes[at].first_child != NO_NODE {
        let node = nodes[at];
        let middle = corner_of(node) + size_of(node) / 2;
        let upper = select(vec3(0i), vec3(1i, 2i, 4i), cell >= middle);
        at = node.first_child + u32(upper.x + upper.y + upper.z);
    }
    return at;
}

fn walk(origin: u32, cell: vec3<i32>) -> u32 {
    var at = origin;
    for (var i = 0; i < 3 * 64; i++) {
        let node = nodes[at];
        let low = corner_of(node);
        let high = low + size_of(node);
        let below = cell < low;
        let above = cell >= high;
        if !any(below | above) {
            return descend(at, cell);
        }
        var axis = 2;
        if below.x || above.x {
            axis = 0;
        } else if below.y || above.y {
            axis = 1;
        }
        let face = 2 * axis + select(0, 1, cell[axis] >= low[axis]);
        let next = nodes[at].neighbours[face];
        if next == NO_NODE {
            break;
        }
        at = next;
    }
    return descend(0u, cell);
}

fn exit_index(node: Node, ray: Ray, place: Place, index: i32, part: f32) -> i32 {
    let at = relative(place, corner_of(node));
    let size = f32(size_of(node));
    var steps = 2e9;
    for (var axis = 0; axis < 3; axis++) {
        if ray.step[axis] != 0.0 {
            let face = select(0.0, size, ray.step[axis] > 0.0);
            steps = min(steps, (face - at[axis]) / ray.step[axis]);
        }
    }
    return index + i32(clamp(ceil(part + steps), 1.0, 1e9));
}

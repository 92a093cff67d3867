// From leaf to leaf by neighbour pointers. Twin of walk.rs.

fn descend(origin: u32, cell: vec3<i32>) -> u32 {
    var at = origin;
    var child = first_child_of(at);
    while child != NO_NODE {
        let cube = cube_at(at);
        let middle = cube.xyz + cube.w / 2;
        let upper = select(vec3(0i), vec3(1i, 2i, 4i), cell >= middle);
        at = child + u32(upper.x + upper.y + upper.z);
        child = first_child_of(at);
    }
    return at;
}

fn walk(origin: u32, cell: vec3<i32>) -> u32 {
    var at = origin;
    for (var i = 0; i < 3 * 64; i++) {
        let cube = cube_at(at);
        let below = cell < cube.xyz;
        let above = cell >= cube.xyz + cube.w;
        if !any(below | above) {
            return descend(at, cell);
        }
        var axis = 2u;
        if below.x || above.x {
            axis = 0u;
        } else if below.y || above.y {
            axis = 1u;
        }
        let next = neighbour_of(at, 2u * axis + select(1u, 0u, below[axis]));
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
    return index + min(i32(clamp(ceil(part + steps), 1.0, 1e9)), 2147483647 - index);
}

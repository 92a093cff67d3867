// The loop over the leaves that a ray goes through. Twin of trace.rs.

const OPAQUE: f32 = 1e-4;
const OPEN: u32 = 1u;
const FAR: f32 = 3.4e38;

struct State {
    color: vec3<f32>,
    left: f32,
    alpha: f32,
    depth: f32,
    best: f32,
    value: f32,
    done_index: i32,
    done_part: f32,
    index: i32,
    part: f32,
    node: u32,
    before: u32,
    flags: u32,
}

fn first_from(index: i32, part: f32, stride: i32) -> i32 {
    let whole = select(index, index + 1, part > 0.0);
    return (whole + stride - 1) / stride * stride;
}

fn stride_of(node: Node) -> i32 {
    return select(1i << data_level_of(node), 1i, node.slot == UNIFORM);
}

fn is_hidden(node: Node, best: f32) -> bool {
    return node.slot == HIDDEN || (MODE == MIP && max(node.values.x, node.values.y) <= best);
}

fn inside(cell: vec3<i32>) -> vec3<i32> {
    return clamp(cell, vec3(0i), frame.dims - 1);
}

fn place_in(leaf: Leaf, ray: Ray, station: Station) -> vec3<f32> {
    return relative(place_at(ray, station), leaf.own.corner);
}

fn advance(leaf: Leaf, ray: Ray, state: ptr<function, State>, last: ptr<function, Entry>, at_from: vec3<f32>, station: Station, at: vec3<f32>) {
    let done = Station((*state).done_index, (*state).done_part);
    let value = value_of(leaf, at, right_level(ray, station));
    let segment = Segment(done, station, at_from, at);
    gather(leaf, ray, segment, state, last, value);
    (*state).done_index = station.index;
    (*state).done_part = station.part;
}

fn close(ray: Ray, state: ptr<function, State>, last: ptr<function, Entry>, end: Station) {
    let node = node_at((*state).before);
    let stride = stride_of(node);
    var station = Station(((*state).done_index / stride + 1) * stride, 0.0);
    if is_before(end, station) {
        station = end;
    }
    let leaf = leaf_of(node);
    let done = Station((*state).done_index, (*state).done_part);
    advance(leaf, ray, state, last, place_in(leaf, ray, done), station, place_in(leaf, ray, station));
    (*state).flags = 0u;
}

fn open(leaf: Leaf, ray: Ray, state: ptr<function, State>, last: ptr<function, Entry>, before: Station) {
    var station = Station((*state).done_index, (*state).done_part);
    if is_before(station, before) {
        station = before;
    }
    let value = value_of(leaf, place_in(leaf, ray, station), right_level(ray, station));
    begin(ray, station, state, last, value);
    (*state).done_index = station.index;
    (*state).done_part = station.part;
    (*state).flags = OPEN;
}

fn trace(ray: Ray, state: ptr<function, State>) -> bool {
    let end = station_at(ray.leave);
    var last = entry_at((*state).value);
    var budget = frame.budget;
    while budget > 0 {
        budget -= 1;
        let node = node_at((*state).node);
        atomicStore(&seen[(*state).node], 1u);
        let here = Station((*state).index, (*state).part);
        let place = place_at(ray, here);
        let exit = exit_index(node, ray, place, here.index, here.part);
        let ends = exit > end.index;
        if is_hidden(node, (*state).best) {
            if (*state).flags == OPEN {
                close(ray, state, &last, end);
            }
        } else {
            let leaf = leaf_of(node);
            let stride = stride_of(node);
            let first = first_from(here.index, here.part, stride);
            if (*state).flags != OPEN {
                open(leaf, ray, state, &last, Station(first - stride, 0.0));
            }
            (*state).before = (*state).node;
            var at_from = place_in(leaf, ray, Station((*state).done_index, (*state).done_part));
            let at_first = place_in(leaf, ray, Station(first, 0.0));
            let beyond = min(exit, end.index + 1);
            var index = first;
            while index < beyond {
                if budget <= 0 {
                    (*state).index = index;
                    (*state).part = 0.0;
                    return false;
                }
                budget -= 1;
                let station = Station(index, 0.0);
                if is_before(Station((*state).done_index, (*state).done_part), station) {
                    let at = at_first + f32(index - first) * ray.step;
                    advance(leaf, ray, state, &last, at_from, station, at);
                    at_from = at;
                    if (*state).left < OPAQUE {
                        return true;
                    }
                }
                if node.slot == UNIFORM && index < beyond - 1 {
                    index = beyond - 1;
                } else {
                    index += stride;
                }
            }
            if ends && is_before(Station((*state).done_index, (*state).done_part), end) {
                advance(leaf, ray, state, &last, at_from, end, place_in(leaf, ray, end));
            }
        }
        if ends || (*state).left < OPAQUE {
            return true;
        }
        (*state).index = exit;
        (*state).part = 0.0;
        let next = place_at(ray, Station(exit, 0.0));
        (*state).node = walk((*state).node, inside(next.cell));
    }
    return false;
}

fn start(ray: Ray) -> State {
    let enter = station_at(ray.enter);
    let cell = inside(place_at(ray, enter).cell);
    return State(
        vec3(0.0), 1.0, 0.0, FAR, -1e30, 0.0, enter.index, enter.part, enter.index, enter.part,
        descend(0u, cell), 0u, 0u,
    );
}

fn output(at: u32, state: State) {
    depths[at] = state.depth;
    if MODE == MIP {
        if state.best <= -1e30 {
            depths[at] = FAR;
            colors[at] = vec4(0.0);
            return;
        }
        let grey = clamp(state.best, 0.0, 1.0);
        colors[at] = vec4(grey, grey, grey, 1.0);
        return;
    }
    colors[at] = vec4(state.color, state.alpha);
}

@compute @workgroup_size(8, 8)
fn draw(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2(id.x, id.y + frame.first_row);
    let rows = arrayLength(&depths) / frame.size.x;
    if id.x >= frame.size.x || id.y >= rows || pixel.y >= frame.size.y {
        return;
    }
    let at = id.y * frame.size.x + id.x;
    var state: State;
    if RESUMED {
        state = states[at];
        if state.index < 0 {
            return;
        }
    } else {
        states[at].index = -1;
    }
    let ray = ray_of(pixel, depths[at]);
    if !RESUMED {
        if ray.leave <= ray.enter {
            depths[at] = FAR;
            colors[at] = vec4(0.0);
            return;
        }
        state = start(ray);
    }
    if trace(ray, &state) {
        output(at, state);
        states[at].index = -1;
    } else {
        states[at] = state;
        atomicStore(&unfinished, 1u);
    }
}

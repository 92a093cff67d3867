// What a segment between two samples adds to a ray. Twin of gather.rs.

const REFINEMENTS: i32 = 6;

struct Segment {
    origin: Station,
    to: Station,
    at_from: vec3<f32>,
    at_to: vec3<f32>,
}

fn distance_at(ray: Ray, segment: Segment, t: f32) -> f32 {
    let index = f32(segment.origin.index) + segment.origin.part + t * between(segment.origin, segment.to);
    return ray.world_before + index * ray.world;
}

fn add_light(leaf: Leaf, ray: Ray, segment: Segment, state: ptr<function, State>, first: Entry, second: Entry) {
    let optics = mean(first, second);
    if optics.w <= 0.0 {
        return;
    }
    let length = between(segment.origin, segment.to) * ray.world;
    let left_share = decay(optics.w * length);
    let left = left_share.x;
    let share = left_share.y;
    var light = optics.xyz;
    if SHADED {
        let at = 0.5 * (segment.at_from + segment.at_to);
        let factor_highlight = light_at(leaf, ray, at, right_level(ray, segment.to));
        light = light * factor_highlight.x + vec3(optics.w * factor_highlight.y);
    }
    (*state).color += ((*state).left * length * share) * light;
    let taken = (*state).left * length * share * optics.w;
    if (*state).alpha < 0.5 && (*state).alpha + taken >= 0.5 {
        (*state).depth = distance_at(ray, segment, (0.5 - (*state).alpha) / taken);
    }
    (*state).alpha += taken;
    (*state).left *= left;
}

fn find_surface(leaf: Leaf, ray: Ray, segment: Segment, state: ptr<function, State>, value: f32) {
    var low = 0.0;
    var high = 1.0;
    var below = (*state).value - frame.isovalue;
    var beyond = value - frame.isovalue;
    if below * beyond > 0.0 || below == beyond {
        return;
    }
    let level = right_level(ray, segment.to);
    var t = below / (below - beyond);
    for (var i = 0; i < REFINEMENTS; i++) {
        let at = segment.at_from + t * (segment.at_to - segment.at_from);
        let found = value_of(leaf, at, level) - frame.isovalue;
        if found * below <= 0.0 {
            high = t;
            beyond = found;
        } else {
            low = t;
            below = found;
        }
        t = 0.5 * (low + high);
        if i % 2 == 1 && below != beyond {
            t = low + (high - low) * (below / (below - beyond));
        }
    }
    var color = frame.surface;
    if SHADED {
        let at = segment.at_from + t * (segment.at_to - segment.at_from);
        let factor_highlight = light_at(leaf, ray, at, level);
        color = color * factor_highlight.x + vec3(factor_highlight.y);
    }
    (*state).color = color;
    (*state).alpha = 1.0;
    (*state).left = 0.0;
    (*state).depth = distance_at(ray, segment, t);
}

fn take_greater(ray: Ray, segment: Segment, state: ptr<function, State>, value: f32) {
    if value > (*state).best {
        (*state).best = value;
        (*state).depth = distance_at(ray, segment, 1.0);
    }
}

fn begin(ray: Ray, station: Station, state: ptr<function, State>, last: ptr<function, Entry>, value: f32) {
    if MODE == DVR {
        *last = entry_at(value);
    } else if MODE != ISO {
        let at = Segment(station, station, vec3(0.0), vec3(0.0));
        take_greater(ray, at, state, value);
    }
    (*state).value = value;
}

fn gather(leaf: Leaf, ray: Ray, segment: Segment, state: ptr<function, State>, last: ptr<function, Entry>, value: f32) {
    if MODE == DVR {
        let entry = entry_at(value);
        add_light(leaf, ray, segment, state, *last, entry);
        *last = entry;
    } else if MODE == ISO {
        find_surface(leaf, ray, segment, state, value);
    } else {
        take_greater(ray, segment, state, value);
    }
    (*state).value = value;
}

// A pixel's ray. Twin of ray.rs.

struct Ray {
    start: Place,
    stride: Place,
    negative: vec3<bool>,
    step: vec3<f32>,
    world: f32,
    world_before: f32,
    direction: vec3<f32>,
    depth: f32,
    depth_step: f32,
    enter: f32,
    leave: f32,
}

struct Station {
    index: i32,
    part: f32,
}

const NOWHERE = 1e-30;

fn ray_of(pixel: vec2<u32>, end: f32) -> Ray {
    let x = f32(pixel.x) + 0.5 - f32(frame.size.x) * 0.5;
    let y = f32(pixel.y) + 0.5 - f32(frame.size.y) * 0.5;
    let from_cell = frame.origin_frac + x * frame.origin_across + y * frame.origin_down;
    let towards = frame.direction + x * frame.direction_across + y * frame.direction_down;
    let squared = dot(towards, towards);
    let length = sqrt(squared);
    let step = towards * (frame.step_voxels / length);
    let world_step = step * frame.spacing;
    let world = sqrt(dot(world_step, world_step));
    let world_towards = towards * frame.spacing;
    let world_before = frame.plane * sqrt(dot(world_towards, world_towards));
    let low = vec3<f32>(frame.clip_min_cell - frame.origin_cell) + frame.clip_min_frac - from_cell;
    let high = vec3<f32>(frame.clip_max_cell - frame.origin_cell) + frame.clip_max_frac - from_cell;
    var enter = 0.0;
    var leave = min((end - world_before) / world, 2e9);
    for (var axis = 0; axis < 3; axis++) {
        if step[axis] == 0.0 {
            if low[axis] > 0.0 || high[axis] <= 0.0 {
                leave = -1.0;
            }
        } else {
            let a = low[axis] / step[axis];
            let b = high[axis] / step[axis];
            enter = max(enter, min(a, b));
            leave = min(leave, max(a, b));
        }
    }
    if squared < NOWHERE {
        leave = -1.0;
    }
    let offset = place_of(from_cell);
    var ray: Ray;
    ray.start = Place(offset.cell + frame.origin_cell, offset.frac);
    ray.stride = place_of(abs(step));
    ray.negative = step < vec3(0.0);
    ray.step = step;
    ray.world = world;
    ray.world_before = world_before;
    ray.direction = world_step / world;
    ray.depth = frame.plane;
    ray.depth_step = frame.step_voxels / length;
    ray.enter = enter;
    ray.leave = leave;
    return ray;
}

fn station_at(index: f32) -> Station {
    let whole = floor(index);
    return Station(i32(whole), index - whole);
}

fn place_at(ray: Ray, station: Station) -> Place {
    let whole = times(ray.stride, u32(station.index));
    let part = place_of(abs(ray.step) * station.part);
    return plus(ray.start, signed(plus(whole, part), ray.negative));
}

fn between(a: Station, b: Station) -> f32 {
    return f32(b.index - a.index) + (b.part - a.part);
}

fn is_before(a: Station, b: Station) -> bool {
    return a.index < b.index || (a.index == b.index && a.part < b.part);
}

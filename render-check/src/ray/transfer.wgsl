// Tables of the transfer function, equation 2, and exp(-x). Twin of transfer.rs.

struct Entry {
    x: f32,
    optics: vec4<f32>,
    whole: vec4<f32>,
    rest: vec4<f32>,
    part: vec4<f32>,
}

const EPSILON: f32 = 1.0 / 64.0;

fn row(entry: i32, which: i32) -> vec4<f32> {
    return textureLoad(table, vec2(3 * (entry & 1023) + which, entry >> 10u), 0);
}

fn entry_at(value: f32) -> Entry {
    let last = frame.last_entry;
    let x = clamp(value * last, -1e6, 1e6);
    let below = clamp(floor(x), 0.0, last);
    let above = clamp(floor(x) + 1.0, 0.0, last);
    let t = x - below;
    let f = row(i32(below), 0);
    let rise = row(i32(above), 0) - f;
    var entry: Entry;
    entry.x = x;
    entry.optics = f + rise * clamp(t, 0.0, 1.0);
    entry.whole = row(i32(below), 1);
    entry.rest = row(i32(below), 2);
    entry.part = t * f + (0.5 * t * t) * rise;
    return entry;
}

fn mean(a: Entry, b: Entry) -> vec4<f32> {
    let width = b.x - a.x;
    if abs(width) > EPSILON {
        let integral = (b.whole - a.whole) + ((b.rest - a.rest) + (b.part - a.part));
        return max(integral / width, vec4(0.0, 0.0, 0.0, 0.0));
    }
    return 0.5 * (a.optics + b.optics);
}

fn decay(x: f32) -> vec2<f32> {
    if x < 0.5 {
        let share = 1.0
            - x * 0.5
                * (1.0 - x * (1.0 / 3.0) * (1.0 - x * 0.25 * (1.0 - x * 0.2 * (1.0 - x * (1.0 / 6.0) * (1.0 - x * (1.0 / 7.0))))));
        return vec2(1.0 - x * share, share);
    }
    let left = exp(-x);
    return vec2(left, (1.0 - left) / x);
}

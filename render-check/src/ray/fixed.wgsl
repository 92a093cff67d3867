// Positions in 32.32 fixed point. Twin of fixed.rs.

const TWO_32: f32 = 4294967296.0;

struct Place {
    cell: vec3<i32>,
    frac: vec3<u32>,
}

fn fraction(v: vec3<f32>, whole: vec3<f32>) -> vec3<u32> {
    return vec3<u32>(min(v - whole, vec3(0.99999994)) * TWO_32);
}

fn place_of(v: vec3<f32>) -> Place {
    let whole = floor(v);
    return Place(vec3<i32>(whole), fraction(v, whole));
}

fn plus(a: Place, b: Place) -> Place {
    let frac = a.frac + b.frac;
    let carry = select(vec3(0i), vec3(1i), frac < a.frac);
    return Place(a.cell + b.cell + carry, frac);
}

fn signed(a: Place, negative: vec3<bool>) -> Place {
    let carry = select(vec3(0i), vec3(1i), a.frac == vec3(0u));
    let cell = ~a.cell + carry;
    let frac = ~a.frac + vec3(1u);
    return Place(select(a.cell, cell, negative), select(a.frac, frac, negative));
}

fn multiply_high(a: u32, b: vec3<u32>) -> vec3<u32> {
    let a_low = a & 0xffffu;
    let a_high = a >> 16u;
    let b_low = b & vec3(0xffffu);
    let b_high = b >> vec3(16u);
    let low = b_low * a_low;
    let middle = b_high * a_low + (low >> vec3(16u));
    let other = b_low * a_high + (middle & vec3(0xffffu));
    return b_high * a_high + (middle >> vec3(16u)) + (other >> vec3(16u));
}

fn times(a: Place, n: u32) -> Place {
    let whole = vec3<u32>(a.cell) * n;
    return Place(vec3<i32>(whole + multiply_high(n, a.frac)), a.frac * n);
}

fn relative(a: Place, corner: vec3<i32>) -> vec3<f32> {
    return vec3<f32>(a.cell - corner) + vec3<f32>(a.frac) * (1.0 / TWO_32);
}

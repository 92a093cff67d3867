//! What is left of light after an optical depth x, and the share that is taken a unit of depth: exp(-x) and
//! (1 - exp(-x)) / x, without cancellation for tiny x.

/// `exp(-x)` and `(1 - exp(-x)) / x` for `x >= 0`.
pub(crate) fn decay(x: f64) -> (f64, f64) {
    let share = if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 };
    ((-x).exp(), share)
}

//! Which instructions the kernels are compiled for that this processor runs.
//!
//! Every kernel of this program is compiled for the same three; all three give the same bits, which
//! `tests/end_to_end/instruction_sets.rs` shows by running the program on processors that lack one.

use multiversion::multiversion;
use multiversion::target::match_target;

/// `AVX-512`, `AVX2`, or `baseline`: what the compiler takes every processor of the kind to have.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq", "x86_64+avx2"))]
pub fn instruction_set() -> &'static str {
    match_target! {
        "x86_64+avx512f+avx512bw+avx512vl+avx512dq" => "AVX-512",
        "x86_64+avx2" => "AVX2",
        _ => "baseline",
    }
}

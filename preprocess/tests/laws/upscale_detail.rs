//! The detail: what is added lies above the source's Nyquist frequency, and nowhere where nothing is.

use crate::support::{bits, index, scan, voxels};
use crate::upscale::{enlarged, plain, raw, times, twin};
use octree_store::Region;
use preprocess::{CubicKernel, Detail, Upscale};
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

fn detailed(factor: u32, amplitude: f64, seed: u64) -> Upscale {
    Upscale::new(factor, CubicKernel::CatmullRom, Some(Detail { amplitude, seed })).unwrap()
}

/// What is added to an enlarged volume, x fastest.
fn detail(dims: [u64; 3], source: &[f32], factor: u32, seed: u64) -> Vec<f64> {
    let with = enlarged(dims, source, detailed(factor, 1.0, seed));
    let without = enlarged(dims, source, plain(factor, CubicKernel::CatmullRom));
    with.iter().zip(without).map(|(a, b)| f64::from(*a) - f64::from(b)).collect()
}

/// Cubes to add detail to: noise alone, where the contrast varies from voxel to voxel; a ball with a sharp
/// surface in empty space, where it is all in a shell; and something of both.
fn subjects(side: u64) -> [(&'static str, Vec<f32>); 3] {
    let dims = [side; 3];
    let middle = side as f64 / 2.0 - 0.5;
    let ball = |at: [u64; 3]| {
        let squares = at.map(|v| (v as f64 - middle) * (v as f64 - middle));
        if squares.iter().sum::<f64>() < middle * middle / 2.0 { 1000.0 } else { 0.0 }
    };
    [
        ("noise", voxels(dims, |at| (bits(1, at) >> 40) as f32 / 1000.0)),
        ("ball", voxels(dims, ball)),
        ("scan", scan(dims, 2)),
    ]
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// The source's size along an axis for some 64 new voxels.
fn side_for(factor: u32) -> u64 {
    u64::from(64 / factor)
}

#[test]
fn averaging_over_source_voxels_leaves_at_most_a_tenth_of_it() {
    for factor in Upscale::FACTORS {
        let side = side_for(factor);
        let dims = [side; 3];
        for (name, source) in subjects(side) {
            let added = detail(dims, &source, factor, 1);
            let f = u64::from(factor);
            let mut means = vec![0.0; source.len()];
            for (i, at) in voxels(times(dims, factor), |at| at).into_iter().enumerate() {
                means[index(dims, at.map(|o| o / f))] += added[i] / (f * f * f) as f64;
            }
            let left = rms(&means) / rms(&added);
            assert!(left <= 0.1, "{name}, factor {factor}: {left}");
        }
    }
}

/// The power at each frequency of a cube, x fastest.
fn power(values: &[f64], side: usize) -> Vec<f64> {
    let mut spectrum: Vec<_> = values.iter().map(|v| Complex::new(*v, 0.0)).collect();
    let fft = FftPlanner::new().plan_fft_forward(side);
    // Along x, then turned so that the next axis is the fastest, three times.
    for _ in 0..3 {
        fft.process(&mut spectrum);
        let mut turned = Vec::with_capacity(spectrum.len());
        for x in 0..side {
            turned.extend(spectrum.iter().skip(x).step_by(side));
        }
        spectrum = turned;
    }
    spectrum.iter().map(Complex::norm_sqr).collect()
}

/// Of a cube's power, what lies in frequencies of which no component is above `low`, and what in those
/// whose greatest component is above `low` and at most `high`; in cycles a cube.
fn shell(power: &[f64], side: usize, low: usize, high: usize) -> f64 {
    let all: f64 = power.iter().sum();
    let greatest = |i: usize| {
        let folded = |k: usize| k.min(side - k);
        folded(i % side).max(folded(i / side % side)).max(folded(i / side / side))
    };
    let within =
        |i: &usize| greatest(*i) > low && greatest(*i) <= high || high == 0 && greatest(*i) <= low;
    (0..power.len()).filter(within).map(|i| power[i]).sum::<f64>() / all
}

#[test]
fn at_most_a_twentieth_of_its_energy_is_below_the_source_s_nyquist_frequency() {
    for factor in Upscale::FACTORS {
        let side = side_for(factor);
        for (name, source) in subjects(side) {
            let added = detail([side; 3], &source, factor, 2);
            let cube = side as usize * factor as usize;
            let power = power(&added, cube);
            // The whole cube of frequencies that the source can hold, corners included.
            let low = shell(&power, cube, side as usize / 2, 0);
            assert!(low <= 0.05, "{name}, factor {factor}: {low}");
        }
    }
}

#[test]
fn every_octave_up_to_the_new_nyquist_frequency_is_filled() {
    // A ramp has the same contrast everywhere, but for the outermost voxels.
    for (factor, octaves) in [(2, 1), (4, 2), (8, 3)] {
        let side = side_for(factor) + 4;
        let ramp = voxels([side; 3], |[x, ..]| 3.0 * x as f32);
        let added = detail([side; 3], &ramp, factor, 3);
        let cube = 64;
        let (edge, wide) = (2 * u64::from(factor), side * u64::from(factor));
        let inner = voxels([cube; 3], |at| added[index([wide; 3], at.map(|v| v + edge))]);
        let power = power(&inner, cube as usize);
        let expected = 1.0 / f64::from(octaves);
        for octave in 0..octaves {
            let low = 32 / factor as usize * (1 << octave);
            let found = shell(&power, cube as usize, low, 2 * low);
            // An octave of the lattice leaks into its neighbours, and they have the same energy.
            assert!(found > 0.6 * expected, "factor {factor} octave {octave}: {found}");
            assert!(found < 1.6 * expected, "factor {factor} octave {octave}: {found}");
        }
    }
}

#[test]
fn its_rms_is_the_amplitude_times_the_local_contrast() {
    for factor in Upscale::FACTORS {
        let side = side_for(factor) + 4;
        let ramp = voxels([side; 3], |[x, y, z]| 3.0 * x as f32 - 6.0 * y as f32 + 1.5 * z as f32);
        let added = detail([side; 3], &ramp, factor, 4);
        let f = u64::from(factor);
        let wide = side * f;
        let inner = voxels([wide - 4 * f; 3], |at| added[index([wide; 3], at.map(|v| v + 2 * f))]);
        // Two of the six neighbours differ by each of the steps.
        let contrast = (3.0 + 6.0 + 1.5) / 3.0;
        let found = rms(&inner) / contrast;
        assert!((found - 1.0).abs() < 0.03, "factor {factor}: {found}");
        let half = enlarged([side; 3], &ramp, detailed(factor, 0.5, 4));
        let none = enlarged([side; 3], &ramp, plain(factor, CubicKernel::CatmullRom));
        for (i, added) in added.iter().enumerate() {
            let found = f64::from(half[i]) - f64::from(none[i]);
            assert!((found - added / 2.0).abs() < 1e-4, "it is linear in the amplitude");
        }
    }
}

#[test]
fn there_is_none_where_all_voxels_around_are_equal() {
    let dims = [12, 10, 11];
    let ball = voxels(dims, |[x, y, z]| {
        if x.abs_diff(3) + y.abs_diff(4) + z.abs_diff(3) < 3 { 5000.0_f32 } else { -7.5 }
    });
    for factor in Upscale::FACTORS {
        let added = detail(dims, &ball, factor, 5);
        let mut flat = 0;
        for (i, at) in voxels(times(dims, factor), |at| at).into_iter().enumerate() {
            let (.., same) = twin(dims, &ball, factor, CubicKernel::CatmullRom, at);
            assert!(!same || added[i] == 0.0, "factor {factor} {at:?}: {}", added[i]);
            flat += usize::from(same);
        }
        assert!(flat * 5 > added.len() && rms(&added) > 1.0);
    }
    let empty = vec![0_u16; 12 * 10 * 11];
    assert!(enlarged(dims, &empty, detailed(4, 100.0, 1)).iter().all(|v| *v == 0));
}

#[test]
fn a_part_has_the_detail_of_the_whole_and_another_seed_another() {
    let dims = [16, 15, 14];
    let source = scan::<f32>(dims, 3);
    let region = Region { min: [3, 2, 4], max: [15, 14, 13] };
    for factor in Upscale::FACTORS {
        let f = u64::from(factor);
        let whole = enlarged(dims, &source, detailed(factor, 1.0, 6));
        let folder = tempfile::tempdir().unwrap();
        let cropped = raw(folder.path(), dims, &source).crop(region).unwrap();
        let cropped = cropped.upscale(detailed(factor, 1.0, 6)).unwrap();
        let part_dims = times(region.dims_xyz(), factor);
        let mut slices = cropped.slices().unwrap();
        let mut slice = vec![0.0_f32; (part_dims[0] * part_dims[1]) as usize];
        for z in 0..part_dims[2] {
            slices.next(&mut slice).unwrap();
            for (i, [x, y, _]) in
                voxels([part_dims[0], part_dims[1], 1], |at| at).into_iter().enumerate()
            {
                let at = [x, y, z];
                // Two voxels from the cut, its edge no longer shows.
                if (0..3).all(|a| at[a] >= 2 * f && at[a] < part_dims[a] - 2 * f) {
                    let place = [0, 1, 2].map(|a| at[a] + f * region.min[a]);
                    assert!(
                        slice[i].to_bits() == whole[index(times(dims, factor), place)].to_bits()
                    );
                }
            }
        }
        let other = enlarged(dims, &source, detailed(factor, 1.0, 7));
        let different = whole.iter().zip(&other).filter(|(a, b)| a != b).count();
        assert!(different * 10 > whole.len() * 9);
    }
}

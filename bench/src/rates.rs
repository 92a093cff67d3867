//! How many random reads a second a store gives: the same places in the same order for every program that
//! includes this file, rounds on several threads, the median printed.

use std::time::Instant;

/// Reads in rounds of `reads` on each thread, after one to warm up, and prints how many a second; `read` gets
/// a thread's seed, counted from 1.
pub(crate) fn print_rate<E: Send>(
    what: &str,
    [threads, reads]: [u64; 2],
    rounds: usize,
    read: impl Fn(u64) -> Result<u64, E> + Sync,
) -> anyhow::Result<()>
where
    anyhow::Error: From<E>,
{
    let mut rates = Vec::new();
    for round in 0..=rounds {
        let started = Instant::now();
        std::thread::scope(|scope| {
            let read = &read;
            let readers: Vec<_> =
                (1..=threads).map(|seed| scope.spawn(move || read(seed))).collect();
            readers.into_iter().try_for_each(|reader| match reader.join() {
                Ok(result) => result.map(drop).map_err(anyhow::Error::from),
                Err(_) => anyhow::bail!("a reader stopped"),
            })
        })?;
        if round > 0 {
            rates.push((reads * threads) as f64 / started.elapsed().as_secs_f64());
        }
    }
    rates.sort_by(f64::total_cmp);
    println!(
        "{threads} threads: {:.0} {what} a second (median of {}; {:.0} to {:.0})",
        rates[rates.len() / 2],
        rates.len(),
        rates[0],
        rates[rates.len() - 1]
    );
    Ok(())
}

/// Places in a grid in a pseudo-random order.
pub(crate) fn places(seed: u64, grid_xyz: [u64; 3], count: u64) -> impl Iterator<Item = [u64; 3]> {
    let [width, height, _] = grid_xyz;
    let all: u64 = grid_xyz.iter().product();
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (0..count).map(move |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let index = state % all;
        [index % width, index / width % height, index / width / height]
    })
}

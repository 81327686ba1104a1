//! Time of filling by the number of voxels, in CPU time of one thread: filling is linear where the throughput (voxels a
//! second) is the same at every spacing, but for what does not depend on it (depth maps).
//!
//! `cargo bench -p gic-continuum --bench filling`

use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput};
use gic_continuum::{FillSettings, fill};

#[allow(dead_code)]
#[path = "../tests/common/mod.rs"]
mod common;

/// Finest voxels along the largest side of the body.
const VOXELS_ACROSS: [f64; 4] = [40.0, 56.0, 80.0, 113.0];

/// Time that this thread has run.
fn cpu_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").expect("needs Linux");
    let nanoseconds = stat.split(' ').next().and_then(|n| n.parse().ok()).expect("schedstat starts with a number");
    Duration::from_nanos(nanoseconds)
}

fn bench(criterion: &mut Criterion) {
    let body = common::torus();
    let cameras = common::cameras_above();
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| common::mask(&body, c)).collect();
    let views = common::views(&cameras, &masks);
    let gaussians = common::perfect_gaussians(&body);
    let mut group = criterion.benchmark_group("fill");
    group.sample_size(10);
    for across in VOXELS_ACROSS {
        let default = FillSettings::for_size(body.size);
        let coarsest = f64::from(1u32 << (default.levels - 1));
        let settings = FillSettings { grid_spacing: body.size / across * coarsest, ..default };
        let voxels = fill(&gaussians, &views, &settings).expect("the body is seen").field.len();
        group.throughput(Throughput::Elements(voxels as u64));
        group.bench_with_input(BenchmarkId::from_parameter(voxels), &settings, |bencher, settings| {
            bencher.iter_custom(|rounds| {
                let start = cpu_time();
                for _ in 0..rounds {
                    std::hint::black_box(fill(&gaussians, &views, settings).expect("the body is seen"));
                }
                cpu_time() - start
            });
        });
    }
    group.finish();
}

fn main() {
    // One thread, this one: its CPU time is all there is.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
    one.expect("no pool was built before");
    let mut criterion = Criterion::default().configure_from_args();
    bench(&mut criterion);
    criterion.final_summary();
}

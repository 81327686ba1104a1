//! Speed of rollouts and gradients, in particle-substeps per second of one core's CPU time ("Melem/s" is M
//! particle-substeps per core-second).
//!
//! `cargo bench -p gic-mpm --bench mpm` measures the readable twin and every SIMD level of the machine on one thread,
//! and the best level on all threads (there, per second of wall time). CPU time makes the figures hold on a busy
//! machine.

mod common;

use std::time::{Duration, Instant};

use common::{falling_cube, materials};
use criterion::measurement::{Measurement, ValueFormatter, WallTime};
use criterion::{BatchSize, BenchmarkId, Criterion, Throughput};
use gic_mpm::{Level, Material, Options, Simulator, World, gradient};

/// CPU time of the calling thread; wall time where the system does not tell.
struct CpuTime(WallTime);

enum Start {
    Cpu(u64),
    Wall(Instant),
}

/// Nanoseconds that this thread has run.
fn thread_nanoseconds() -> Option<u64> {
    std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}

impl Measurement for CpuTime {
    type Intermediate = Start;
    type Value = Duration;

    fn start(&self) -> Start {
        thread_nanoseconds().map_or_else(|| Start::Wall(Instant::now()), Start::Cpu)
    }
    fn end(&self, start: Start) -> Duration {
        match start {
            Start::Cpu(start) => Duration::from_nanos(thread_nanoseconds().unwrap_or(start) - start),
            Start::Wall(start) => start.elapsed(),
        }
    }
    fn add(&self, a: &Duration, b: &Duration) -> Duration {
        *a + *b
    }
    fn zero(&self) -> Duration {
        Duration::ZERO
    }
    fn to_f64(&self, value: &Duration) -> f64 {
        self.0.to_f64(value)
    }
    fn formatter(&self) -> &dyn ValueFormatter {
        self.0.formatter()
    }
}

/// About `particles` particles.
fn world(material: Material, particles: usize, substeps: usize) -> World {
    falling_cube(material, (particles as f64).cbrt().round() as usize, substeps)
}

/// Names and options of what is compared: the twin, then each level.
fn engines() -> Vec<(String, Options)> {
    let one = Options { parallel: false, ..Options::default() };
    let twin = ("twin".to_owned(), Options { twin: true, ..one.clone() });
    let levels = Level::supported().map(|level| (level.to_string(), Options { level: Some(level), ..one.clone() }));
    std::iter::once(twin).chain(levels).collect()
}

fn forward(c: &mut Criterion<CpuTime>) {
    for (particles, substeps) in [(60_000, 100), (500_000, 20)] {
        for material in materials() {
            let world = world(material, particles, substeps);
            let mut group = c.benchmark_group(format!("forward/{}/{particles}", material.model()));
            group.throughput(Throughput::Elements((world.bodies[0].positions.len() * substeps) as u64));
            group.sample_size(10);
            for (name, options) in engines() {
                group.bench_function(BenchmarkId::from_parameter(name), |b| {
                    b.iter_batched_ref(
                        || Simulator::new(&world, &options).expect("the world is valid"),
                        |simulator| simulator.advance_frame().expect("the frame is stable"),
                        BatchSize::PerIteration,
                    );
                });
            }
        }
    }
}

fn backward(c: &mut Criterion<CpuTime>) {
    let (particles, substeps) = (60_000, 80);
    for material in materials() {
        let world = world(material, particles, substeps);
        let mut group = c.benchmark_group(format!("gradient/{}/{particles}", material.model()));
        group.throughput(Throughput::Elements((world.bodies[0].positions.len() * substeps) as u64));
        group.sample_size(10);
        for (name, options) in engines() {
            group.bench_function(BenchmarkId::from_parameter(name), |b| {
                b.iter(|| {
                    gradient(&world, &options, 2, |frame| (frame.index == 1).then(|| frame.positions.clone()))
                        .expect("the rollout is stable")
                });
            });
        }
    }
}

/// One thread against all, in wall time.
fn threads(c: &mut Criterion) {
    let (particles, substeps) = (500_000, 20);
    let world = world(materials()[0], particles, substeps);
    let mut group = c.benchmark_group(format!("threads/elastic/{particles}"));
    group.throughput(Throughput::Elements((world.bodies[0].positions.len() * substeps) as u64));
    group.sample_size(10);
    for (name, parallel) in [("one", false), ("all", true)] {
        let options = Options { parallel, ..Options::default() };
        group.bench_function(name, |b| {
            b.iter_batched_ref(
                || Simulator::new(&world, &options).expect("the world is valid"),
                |simulator| simulator.advance_frame().expect("the frame is stable"),
                BatchSize::PerIteration,
            );
        });
    }
}

fn main() {
    let mut cpu = Criterion::default().with_measurement(CpuTime(WallTime)).configure_from_args();
    forward(&mut cpu);
    backward(&mut cpu);
    let mut wall = Criterion::default().configure_from_args();
    threads(&mut wall);
    wall.final_summary();
}

//! Speed of the rasteriser on one thread: `cargo bench -p gic-splat --bench splat`.
//!
//! Throughput is in Gaussian-pixel pairs: pixels where a Gaussian's own alpha reaches 1/255, hidden by others or not.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::measurement::{Measurement, ValueFormatter, WallTime};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use gic_scene::Camera;
use gic_simd::Level;
use gic_splat::twin::{self, Cutoffs, GaussiansF64, PicturesF64};
use gic_splat::{Channels, Gaussians, ImageGradients, RenderSettings, Shape, backward, render};
use glam::{DMat3, DVec2};
use mimalloc::MiMalloc;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The allocator of the program.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Time on the processor of the thread that measures, where the system tells (Linux); time on the wall elsewhere. Other
/// work on the machine does not count in it.
struct ThreadTime {
    origin: Instant,
}

impl ThreadTime {
    fn now(&self) -> Duration {
        let on_processor = std::fs::read_to_string("/proc/thread-self/schedstat")
            .ok()
            .and_then(|text| text.split_whitespace().next()?.parse().ok())
            .map(Duration::from_nanos);
        on_processor.unwrap_or_else(|| self.origin.elapsed())
    }
}

impl Measurement for ThreadTime {
    type Intermediate = Duration;
    type Value = Duration;

    fn start(&self) -> Duration {
        self.now()
    }
    fn end(&self, start: Duration) -> Duration {
        self.now() - start
    }
    fn add(&self, a: &Duration, b: &Duration) -> Duration {
        *a + *b
    }
    fn zero(&self) -> Duration {
        Duration::ZERO
    }
    fn to_f64(&self, value: &Duration) -> f64 {
        value.as_nanos() as f64
    }
    fn formatter(&self) -> &dyn ValueFormatter {
        WallTime.formatter()
    }
}

/// A camera in the origin that looks along z at a ball of radius 0.2 m in 1 m distance, whose disc is a fifth of the
/// picture.
fn camera(side: usize) -> Camera {
    let radius = (0.2 / std::f64::consts::PI).sqrt() * side as f64;
    Camera {
        width: side,
        height: side,
        focal: DVec2::splat(radius / 0.2),
        principal: DVec2::splat(0.5 * side as f64),
        world_from_camera: DMat3::IDENTITY,
        centre: glam::DVec3::ZERO,
    }
}

/// A ball full of isotropic Gaussians of random opacity; `sigma` is in pixels of a 400x400 picture.
fn ball(n: usize, sigma: f64, opacity: (f32, f32)) -> Gaussians {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let scale = sigma / camera(400).focal.x;
    let mut gaussians = Gaussians {
        positions: Vec::new(),
        opacities: Vec::new(),
        shape: Shape::Isotropic { scales: vec![scale as f32; n] },
        sh_degree: 3,
        sh: Vec::new(),
    };
    while gaussians.positions.len() < n {
        let p: [f32; 3] = std::array::from_fn(|_| rng.random::<f32>() * 0.4 - 0.2);
        if p.iter().map(|v| v * v).sum::<f32>() <= 0.04 {
            gaussians.positions.push([p[0], p[1], p[2] + 1.0]);
            gaussians.opacities.push(opacity.0 + (opacity.1 - opacity.0) * rng.random::<f32>());
            gaussians.sh.extend((0..16).map(|_| [0; 3].map(|_| rng.random::<f32>() * 0.4 - 0.2)));
        }
    }
    gaussians
}

/// Pixels in which each Gaussian alone would be drawn, counted one Gaussian at a time.
fn pairs(gaussians: &Gaussians, camera: &Camera, settings: &RenderSettings) -> u64 {
    let Shape::Isotropic { scales } = &gaussians.shape else { unreachable!("the ball is isotropic") };
    let mut count = 0;
    for (i, p) in gaussians.positions.iter().enumerate() {
        let p = glam::DVec3::from_array(p.map(f64::from));
        let Some((mean, z)) = camera.project(p) else { continue };
        // On this side of the perspective's shear, which stays below 5 % here.
        let variance = (camera.focal.x * f64::from(scales[i]) / z).powi(2) + f64::from(settings.dilation);
        let reach = (2.0 * (255.0 * f64::from(gaussians.opacities[i])).ln() * variance).sqrt();
        for y in (mean.y - reach) as usize..=(mean.y + reach) as usize {
            for x in (mean.x - reach) as usize..=(mean.x + reach) as usize {
                let d = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - mean;
                count += u64::from(d.length_squared() <= reach * reach);
            }
        }
    }
    count
}

fn image_gradients(camera: &Camera) -> ImageGradients {
    let n = camera.width * camera.height;
    ImageGradients { color: vec![[0.3, -0.2, 0.1]; n], alpha: vec![0.5; n], depth: vec![-0.1; n] }
}

fn both(gaussians: &Gaussians, camera: &Camera, settings: &RenderSettings, loss: &ImageGradients) {
    let rendered = render(gaussians, camera, settings);
    black_box(backward(gaussians, camera, settings, &rendered, loss));
}

/// Runs on one thread, so that figures are per core.
fn one_thread(work: impl FnOnce() + Send) {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread pool").install(work);
}

/// Issue figure: 400x400, 10k isotropic Gaussians over a fifth of the picture, colour + alpha + depth.
fn reference(c: &mut Criterion<ThreadTime>) {
    let (camera, settings) = (camera(400), RenderSettings::default());
    for sigma in [1.5, 2.5] {
        let gaussians = ball(10_000, sigma, (0.3, 0.9));
        let loss = image_gradients(&camera);
        let mut group = c.benchmark_group(format!("400x400_10k_sigma{sigma}px"));
        group.throughput(Throughput::Elements(pairs(&gaussians, &camera, &settings)));
        for level in Level::supported() {
            let settings = RenderSettings { level, ..settings.clone() };
            group.bench_function(format!("forward_{level}"), |b| {
                one_thread(|| b.iter(|| black_box(render(&gaussians, &camera, &settings))));
            });
            group.bench_function(format!("forward_backward_{level}"), |b| {
                one_thread(|| b.iter(|| both(&gaussians, &camera, &settings, &loss)));
            });
        }
        group.bench_function("forward_backward_twin", |b| {
            let (set, loss) = (GaussiansF64::from(&gaussians), PicturesF64::from(&loss));
            b.iter(|| {
                black_box(twin::render(&set, &camera, &settings, Cutoffs::Hard));
                black_box(twin::backward(&set, &camera, &settings, Cutoffs::Hard, &loss));
            });
        });
        group.finish();
    }
}

/// The continuum's particles: alpha only, many and small.
fn masks(c: &mut Criterion<ThreadTime>) {
    let (camera, settings) = (camera(400), RenderSettings::masks());
    for n in [8_000, 60_000] {
        // About as wide as the particles' spacing.
        let sigma = 0.35 * camera.focal.x * (4.0 / 3.0 * std::f64::consts::PI * 0.008 / n as f64).cbrt();
        let gaussians = ball(n, sigma, (0.6, 0.9999));
        let loss = ImageGradients { alpha: vec![0.5; 160_000], ..ImageGradients::default() };
        let mut group = c.benchmark_group(format!("masks_400x400_{n}_sigma{sigma:.1}px"));
        group.throughput(Throughput::Elements(pairs(&gaussians, &camera, &settings)));
        group.bench_function("forward", |b| {
            one_thread(|| b.iter(|| black_box(render(&gaussians, &camera, &settings))));
        });
        group.bench_function("forward_backward", |b| {
            one_thread(|| b.iter(|| both(&gaussians, &camera, &settings, &loss)));
        });
        group.finish();
    }
}

/// Cost against the number of Gaussians, and against the pixels they cover.
fn linearity(c: &mut Criterion<ThreadTime>) {
    let settings = RenderSettings { channels: Channels::ColorAlphaDepth, ..RenderSettings::default() };
    let mut group = c.benchmark_group("gaussians");
    for n in [5_000, 10_000, 20_000, 40_000] {
        let (gaussians, camera) = (ball(n, 1.5, (0.02, 0.06)), camera(400));
        let loss = image_gradients(&camera);
        group.throughput(Throughput::Elements(pairs(&gaussians, &camera, &settings)));
        group.bench_with_input(BenchmarkId::from_parameter(n), &gaussians, |b, g| {
            one_thread(|| b.iter(|| both(g, &camera, &settings, &loss)));
        });
    }
    group.finish();
    let mut group = c.benchmark_group("pixels");
    for side in [200, 400, 800] {
        let (gaussians, camera) = (ball(10_000, 1.5, (0.02, 0.06)), camera(side));
        let loss = image_gradients(&camera);
        group.throughput(Throughput::Elements(pairs(&gaussians, &camera, &settings)));
        group.bench_with_input(BenchmarkId::from_parameter(side), &gaussians, |b, g| {
            one_thread(|| b.iter(|| both(g, &camera, &settings, &loss)));
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .with_measurement(ThreadTime { origin: Instant::now() })
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = reference, masks, linearity
}
criterion_main!(benches);

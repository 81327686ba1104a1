//! `cargo bench -p gic-metrics`: SSIM forward and backward at 400x400, chamfer and earth mover's distance at their full
//! sizes.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use gic_metrics::{Rectangle, chamfer, earth_mover, sample_volume, ssim, ssim_with_gradient};

fn images(c: &mut Criterion) {
    let (width, height) = (400, 400);
    let picture = |phase: f32| -> Vec<[f32; 3]> {
        (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as f32, (i / width) as f32);
                [0.0, 1.0, 2.0].map(|k| 0.5 + 0.5 * (0.1 * x + 0.05 * y + k + phase).sin())
            })
            .collect()
    };
    let (a, b) = (picture(0.0), picture(0.3));
    let object = Rectangle { left: 120, top: 100, right: 290, bottom: 280 };
    c.bench_function("ssim 400x400x3", |t| t.iter(|| ssim(black_box(&a), &b, width, height, None)));
    c.bench_function("ssim_with_gradient 400x400x3", |t| {
        t.iter(|| ssim_with_gradient(black_box(&a), &b, width, height, None))
    });
    c.bench_function("ssim_with_gradient 170x180x3 of 400x400x3", |t| {
        t.iter(|| ssim_with_gradient(black_box(&a), &b, width, height, Some(object)))
    });
}

fn clouds(c: &mut Criterion) {
    let truth: Vec<[f32; 3]> = (0..7000).map(|i| [i % 28, i / 28 % 25, i / 700].map(|c| 0.01 * c as f32)).collect();
    let (a, b) = (sample_volume(&truth, 0.01, 8192, 1), sample_volume(&truth, 0.01, 8192, 2));
    c.bench_function("chamfer 8192", |t| t.iter(|| chamfer(black_box(&a), &b, 0)));
    let mut group = c.benchmark_group("assignment");
    group.sample_size(10);
    group.bench_function("earth_mover 2048", |t| t.iter(|| earth_mover(black_box(&a), &b, 0)));
}

criterion_group!(benches, images, clouds);
criterion_main!(benches);

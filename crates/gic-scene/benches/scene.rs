//! Reading, matting, carving and inspecting a PAC-NeRF scene of 11 cameras x 14 frames at 400x400:
//! `cargo bench -p gic-scene`. Needs the measured scenes next to the repository (`../shared`).

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use gic_scene::{Hull, HullSettings, HullView, Scene, difference_matte, inspect};

fn scene(c: &mut Criterion) {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/scenes/torus"));
    if !root.exists() {
        println!("SKIPPED: {} is not there", root.display());
        return;
    }
    let mut group = c.benchmark_group("scene");
    group.sample_size(10);
    group.bench_function("open", |b| b.iter(|| Scene::open(black_box(root)).expect("opens")));
    let scene = Scene::open(root).expect("opens");
    group.bench_function("load one view", |b| b.iter(|| scene.load_view(0, black_box(0)).expect("pixels")));
    group.bench_function("load all 154 views", |b| b.iter(|| scene.load_all(&scene.views).expect("pixels").len()));
    group.bench_function("inspect", |b| b.iter(|| inspect(black_box(&scene)).expect("a report")));

    let masks = scene.load_masks(scene.views_at(0)).expect("masks");
    let views: Vec<HullView> = scene
        .views_at(0)
        .iter()
        .zip(&masks)
        .map(|(view, mask)| HullView { camera: scene.camera_of(view), mask })
        .collect();
    for resolution in [64, 128] {
        let settings = HullSettings { resolution, tolerated_misses: 0 };
        group.bench_function(format!("carve, {resolution} cells"), |b| {
            b.iter(|| Hull::carve(black_box(&views), &settings))
        });
    }
    let hull = Hull::carve(&views, &HullSettings::default()).expect("a hull");
    group.bench_function("silhouette", |b| b.iter(|| hull.reprojection_iou(black_box(&views[0]))));

    let (picture, _) = scene.load_view(0, 6).expect("pixels");
    let background = scene.load_background(0).expect("readable").expect("there");
    group.bench_function("matte one view", |b| b.iter(|| difference_matte(black_box(&picture), &background)));
    group.finish();
}

criterion_group!(benches, scene);
criterion_main!(benches);

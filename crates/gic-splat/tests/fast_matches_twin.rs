//! The fast path against the f64 twin: pictures and gradients, isotropic and anisotropic, at every SIMD level of this
//! machine.

use gic_scene::Camera;
use gic_simd::Level;
use gic_splat::twin::{self, Cutoffs, GaussiansF64, PicturesF64};
use gic_splat::{
    Channels, GaussianGradients, Gaussians, ImageGradients, RenderSettings, Rendered, Shape, backward, render,
};
use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn camera() -> Camera {
    Camera {
        width: 53,
        height: 38,
        focal: DVec2::new(50.0, 54.0),
        principal: DVec2::new(26.0, 20.5),
        world_from_camera: DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -0.4, 0.2),
        centre: DVec3::new(0.3, -0.2, 0.1),
    }
}

/// What to make Gaussians of.
#[derive(Clone, Copy)]
struct Recipe {
    n: usize,
    isotropic: bool,
    /// Range of the standard deviation [pixels].
    size: (f64, f64),
    opacity: (f64, f64),
    seed: u64,
}

fn scene(recipe: Recipe) -> Gaussians {
    let camera = camera();
    let mut rng = ChaCha8Rng::seed_from_u64(recipe.seed);
    let mut u = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let mut set = Gaussians {
        positions: Vec::new(),
        opacities: Vec::new(),
        shape: Shape::Isotropic { scales: Vec::new() },
        sh_degree: 3,
        sh: Vec::new(),
    };
    let (mut scales, mut rotations) = (Vec::new(), Vec::new());
    for _ in 0..recipe.n {
        let depth = u(0.5, 3.0);
        let position = camera.unproject(DVec2::new(u(-12.0, 65.0), u(-12.0, 50.0)), depth);
        set.positions.push(position.as_vec3().to_array());
        set.opacities.push(u(recipe.opacity.0, recipe.opacity.1) as f32);
        scales.push([0; 3].map(|_| (u(recipe.size.0, recipe.size.1) * depth / 52.0) as f32));
        rotations.push([0; 4].map(|_| u(-1.0, 1.0) as f32));
        set.sh.extend((0..16).map(|_| [0; 3].map(|_| u(-0.7, 0.7) as f32)));
    }
    set.shape = if recipe.isotropic {
        Shape::Isotropic { scales: scales.iter().map(|s| s[0]).collect() }
    } else {
        Shape::Anisotropic { scales, rotations }
    };
    set
}

fn image_gradients(seed: u64) -> ImageGradients {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut u = || rng.random::<f32>() * 2.0 - 1.0;
    let n = camera().width * camera().height;
    ImageGradients {
        color: (0..n).map(|_| [u(), u(), u()]).collect(),
        alpha: (0..n).map(|_| u()).collect(),
        depth: (0..n).map(|_| u()).collect(),
    }
}

/// Few and many, faint and opaque (which ends pixels early), small, large.
const RECIPES: [Recipe; 5] = [
    Recipe { n: 40, isotropic: true, size: (1.0, 6.0), opacity: (0.1, 0.9), seed: 1 },
    Recipe { n: 40, isotropic: false, size: (1.0, 6.0), opacity: (0.1, 0.9), seed: 2 },
    Recipe { n: 400, isotropic: true, size: (1.0, 5.0), opacity: (0.8, 0.999), seed: 3 },
    Recipe { n: 300, isotropic: false, size: (0.2, 1.5), opacity: (0.05, 0.95), seed: 4 },
    Recipe { n: 60, isotropic: false, size: (10.0, 60.0), opacity: (0.05, 0.5), seed: 5 },
];

fn settings() -> [RenderSettings; 2] {
    let plain = RenderSettings { background: [0.2, 0.5, 0.9], ..RenderSettings::default() };
    [RenderSettings { compensate: true, dilation: 0.1, max_sh_degree: 2, ..plain.clone() }, plain]
}

fn close(name: &str, fast: impl IntoIterator<Item = f32>, twin: impl IntoIterator<Item = f64>, tolerance: f64) {
    let (fast, twin): (Vec<f32>, Vec<f64>) = (fast.into_iter().collect(), twin.into_iter().collect());
    assert_eq!(fast.len(), twin.len(), "{name}: length");
    let largest = twin.iter().fold(1e-3, |m: f64, v| m.max(v.abs()));
    for (i, (a, b)) in fast.iter().zip(&twin).enumerate() {
        let error = (f64::from(*a) - b).abs();
        assert!(error <= tolerance * largest, "{name} {i}: fast {a}, twin {b}, largest {largest}");
    }
}

fn same_pictures(name: &str, fast: &Rendered, twin: &PicturesF64) {
    close(&format!("{name} alpha"), fast.alpha.iter().copied(), twin.alpha.iter().copied(), 2e-5);
    close(&format!("{name} depth"), fast.depth.iter().copied(), twin.depth.iter().copied(), 2e-5);
    let twin_color = twin.color.iter().flat_map(|c| c.to_array());
    close(&format!("{name} color"), fast.color.iter().flatten().copied(), twin_color, 2e-5);
}

fn same_gradients(name: &str, fast: &GaussianGradients, twin: &GaussianGradients) {
    let rows = |name2: &str, a: &[[f32; 3]], b: &[[f32; 3]]| {
        close(&format!("{name} {name2}"), a.iter().flatten().copied(), b.iter().flatten().map(|&v| v.into()), 2e-4)
    };
    let values = |name2: &str, a: &[f32], b: &[f32]| {
        close(&format!("{name} {name2}"), a.iter().copied(), b.iter().map(|&v| v.into()), 2e-4)
    };
    rows("position", &fast.positions, &twin.positions);
    values("opacity", &fast.opacities, &twin.opacities);
    rows("sh", &fast.sh, &twin.sh);
    values("screen", &fast.screen, &twin.screen);
    match (&fast.shape, &twin.shape) {
        (Shape::Isotropic { scales: a }, Shape::Isotropic { scales: b }) => values("scale", a, b),
        (Shape::Anisotropic { scales: a, rotations: qa }, Shape::Anisotropic { scales: b, rotations: qb }) => {
            rows("scale", a, b);
            values("rotation", qa.as_flattened(), qb.as_flattened());
        }
        _ => panic!("{name}: another kind of shape"),
    }
}

#[test]
fn pictures_and_gradients_match_the_twin_at_every_level() {
    let (camera, loss) = (camera(), image_gradients(9));
    for recipe in RECIPES {
        let gaussians = scene(recipe);
        let set = GaussiansF64::from(&gaussians);
        for settings in settings() {
            for channels in [Channels::ColorAlphaDepth, Channels::ColorAlpha, Channels::AlphaDepth, Channels::Alpha] {
                let settings = RenderSettings { channels, ..settings.clone() };
                let pictures = twin::render(&set, &camera, &settings, Cutoffs::Hard);
                assert!(pictures.alpha.iter().any(|&a| a > 0.1), "the scene is empty");
                let gradient = twin::backward(&set, &camera, &settings, Cutoffs::Hard, &PicturesF64::from(&loss));
                let gradient = gradient.to_f32(&gaussians);
                for level in Level::supported() {
                    let name = format!("seed {} {channels:?} {level}", recipe.seed);
                    let settings = RenderSettings { level, ..settings.clone() };
                    let rendered = render(&gaussians, &camera, &settings);
                    assert_eq!(rendered.rejected, 0);
                    same_pictures(&name, &rendered, &pictures);
                    let fast = backward(&gaussians, &camera, &settings, &rendered, &loss);
                    same_gradients(&name, &fast, &gradient);
                }
            }
        }
    }
}

#[test]
fn an_empty_picture_gradient_means_zero() {
    let (camera, loss, gaussians) = (camera(), image_gradients(9), scene(RECIPES[0]));
    let settings = RenderSettings::default();
    let rendered = render(&gaussians, &camera, &settings);
    let zero = ImageGradients { color: vec![[0.0; 3]; loss.color.len()], ..ImageGradients::default() };
    let none = backward(&gaussians, &camera, &settings, &rendered, &ImageGradients::default());
    assert_eq!(none, GaussianGradients::zeros(&gaussians));
    let alpha_only = ImageGradients { alpha: loss.alpha.clone(), ..ImageGradients::default() };
    let with_zeros = ImageGradients { alpha: loss.alpha, depth: vec![0.0; zero.color.len()], ..zero };
    assert_eq!(
        backward(&gaussians, &camera, &settings, &rendered, &alpha_only),
        backward(&gaussians, &camera, &settings, &rendered, &with_zeros)
    );
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let (camera, loss, gaussians) = (camera(), image_gradients(9), scene(RECIPES[2]));
    let settings = RenderSettings::default();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| {
            let rendered = render(&gaussians, &camera, &settings);
            let gradient = backward(&gaussians, &camera, &settings, &rendered, &loss);
            (rendered.color, rendered.alpha, rendered.depth, gradient)
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}

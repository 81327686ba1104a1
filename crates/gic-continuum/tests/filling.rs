//! Filling bodies whose shape is known, from perfect and from noisy Gaussians: errors of volume and surface stay within
//! the grid's size.

mod common;

use common::{
    Body, bridge, cameras, cameras_above, hollow_box, mask, noisy_gaussians, normal, perfect_gaussians, pile, plates,
    sphere, torus, views,
};
use gic_continuum::{
    ContinuumError, Drawing, FillSettings, Filling, MaskedView, ParticleTuning, Particles, Tuning, Unseen, calibrate,
    compare_with_masks, fill, sample_particles,
};
use gic_geometry::{GeometryError, KdTree, Plane, SurfacePoint};
use gic_scene::Camera;
use gic_splat::{Gaussians, Shape};
use glam::{DMat3, DVec3};

/// Distances between the filled surface and the true one [m].
struct SurfaceError {
    /// Largest distance of a vertex of the mesh to the true surface (hollows left out).
    outward: f64,
    /// Largest distance of a point of the true outer surface to the mesh.
    inward: f64,
    mean: f64,
}

fn surface_error(body: &Body, filling: &Filling) -> SurfaceError {
    let mesh = filling.surface_mesh();
    assert!(mesh.is_watertight());
    let to_truth: Vec<f64> = mesh.vertices.iter().map(|&v| (body.distance)(v).abs()).collect();
    let points: Vec<[f32; 3]> = mesh.sample(0.002, 1).iter().map(|s| s.position.as_vec3().to_array()).collect();
    let tree = KdTree::new(&points);
    let outer = common::surface_points(body, 0.006);
    let inward = outer
        .iter()
        .filter(|p| body.name != "box with a hollow" || p.abs().max_element() > 0.06)
        .map(|p| f64::from(tree.nearest(p.as_vec3().to_array()).unwrap().1).sqrt())
        .fold(0.0, f64::max);
    SurfaceError {
        outward: to_truth.iter().copied().fold(0.0, f64::max),
        inward,
        mean: to_truth.iter().sum::<f64>() / to_truth.len() as f64,
    }
}

/// The default settings.
fn settings_for(body: &Body) -> FillSettings {
    FillSettings::for_size(body.size)
}

/// Largest distance between filled and true surface from perfect Gaussians, in finest voxels: the corners of boxes.
const PERFECT: f64 = 2.0;
/// The same from noisy Gaussians: dents where neighbours are missing.
const NOISY: f64 = 3.0;
/// Volume error as the mean shift of the surface, in finest voxels.
const SHIFT: f64 = 0.5;

/// Fills from cameras all around and checks.
fn check(body: &Body, gaussians: &Gaussians, hausdorff: f64) {
    check_seen_by(&cameras(), body, gaussians, None, hausdorff);
}

/// Fills and checks: Hausdorff distance and volume error in units of the finest voxel.
fn check_seen_by(cameras: &[Camera], body: &Body, gaussians: &Gaussians, ground: Option<Plane>, hausdorff: f64) {
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| mask(body, c)).collect();
    let settings = FillSettings { ground, ..settings_for(body) };
    let h = settings.finest_spacing();
    let filling = fill(gaussians, &views(cameras, &masks), &settings).unwrap();
    let error = surface_error(body, &filling);
    // Volume error as the mean shift of the surface.
    let offset = (filling.volume() - body.volume) / body.area;
    println!(
        "{}: h {:.1} mm, Hausdorff {:.2} / {:.2} h, mean {:.2} h, volume {:+.2} %, i.e. {:+.3} h",
        body.name,
        1e3 * h,
        error.outward / h,
        error.inward / h,
        error.mean / h,
        100.0 * (filling.volume() / body.volume - 1.0),
        offset / h
    );
    assert!(error.outward < hausdorff * h && error.inward < hausdorff * h, "{}", body.name);
    assert!(offset.abs() < SHIFT * h, "{}: {offset}", body.name);
}

#[test]
fn sphere_from_perfect_and_noisy_gaussians() {
    check(&sphere(), &perfect_gaussians(&sphere()), PERFECT);
    check(&sphere(), &noisy_gaussians(&sphere(), 1), NOISY);
}

#[test]
fn torus_keeps_its_hole() {
    check(&torus(), &perfect_gaussians(&torus()), PERFECT);
    check(&torus(), &noisy_gaussians(&torus(), 2), NOISY);
}

#[test]
fn box_has_its_hollow_filled() {
    check(&hollow_box(), &perfect_gaussians(&hollow_box()), PERFECT);
    check(&hollow_box(), &noisy_gaussians(&hollow_box(), 3), NOISY);
}

#[test]
fn thin_plates_stay_two() {
    check(&plates(), &perfect_gaussians(&plates()), PERFECT);
    check(&plates(), &noisy_gaussians(&plates(), 4), NOISY);
}

/// Late frames of liquids and sand: every camera looks down, so the silhouettes alone leave a cone over the pile and
/// all of the ground below it. Gaussians are left out where nothing sees them, on the underside. The limit is [`NOISY`]
/// even for perfect Gaussians: a rim of 31 degrees ends 1.7 voxels beyond the place where it is one voxel thick.
#[test]
fn flat_pile_on_the_ground_seen_from_above() {
    let ground = Some(Plane { point: DVec3::ZERO, normal: DVec3::Y });
    for mut gaussians in [perfect_gaussians(&pile()), noisy_gaussians(&pile(), 5), sunken(&pile(), 6)] {
        leave_out(&mut gaussians, |p| p[1].abs() < 0.01 && p[0].hypot(p[2]) < 0.2);
        check_seen_by(&cameras_above(), &pile(), &gaussians, ground, NOISY);
    }
}

/// Fills a body that only cameras above see, of which the Gaussians of its undersides are missing.
fn fill_seen_from_above(body: &Body, settings: &FillSettings) -> Filling {
    let mut gaussians = perfect_gaussians(body);
    leave_out(&mut gaussians, |p| normal(body, DVec3::from(p.map(f64::from))).y < -0.5);
    let cameras = cameras_above();
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| mask(body, c)).collect();
    fill(&gaussians, &views(&cameras, &masks), settings).unwrap()
}

/// The largest body fills most of the notch of a bridge. What is certain about it is its volume, where that is known
/// from elsewhere.
#[test]
fn undersides_that_no_camera_sees_are_smooth_and_give_the_known_volume() {
    let body = bridge();
    let excess = |settings: FillSettings| fill_seen_from_above(&body, &settings).volume() / body.volume - 1.0;
    let largest = excess(FillSettings { unseen: Unseen::Fill, ..settings_for(&body) });
    let smooth = excess(settings_for(&body));
    let known = excess(FillSettings { volume: Some(body.volume), ..settings_for(&body) });
    println!("volume less the true one: largest {largest:+.4}, smooth {smooth:+.4}, known {known:+.4}");
    assert!(largest > 0.1, "the notch is not hidden: {largest}");
    assert!(smooth < 0.8 * largest && smooth > 0.0, "{smooth}");
    // A compromise with where undersides are expected: the volume is met in part.
    assert!(known.abs() < 0.5 * smooth, "{known}");
}

#[test]
fn a_pile_that_hovers_over_the_floor_is_not_filled_down_to_it() {
    let body = pile();
    let ground = Some(Plane { point: DVec3::NEG_Y * 0.01, normal: DVec3::Y });
    let excess = |volume| {
        let settings = FillSettings { ground, volume, grid_spacing: body.size / 10.0, ..settings_for(&body) };
        fill_seen_from_above(&body, &settings).volume() / body.volume - 1.0
    };
    let (unknown, known) = (excess(None), excess(Some(body.volume)));
    println!("volume less the true one: {unknown:+.4}, where it is known {known:+.4}");
    assert!(unknown > 0.15, "{unknown}");
    assert!(known.abs() < 0.2 * unknown, "{known}");
}

#[test]
fn particles_near_undersides_are_in_doubt_and_those_behind_seen_surfaces_are_not() {
    let body = bridge();
    let filling = fill_seen_from_above(&body, &settings_for(&body));
    let particles = sample_particles(&filling, 0.01, &ParticleTuning::default()).unwrap();
    let doubts = || particles.positions.iter().zip(&particles.doubts);
    assert!(particles.doubts.iter().all(|d| (0.0..=1.0).contains(d)));
    // No underside is within 4 voxels of the upper half of the middle; upright edges are rendered too softly to count
    // as seen.
    assert!(doubts().filter(|(p, _)| p.y > 0.05 && p.x.abs() < 0.1 && p.z.abs() < 0.08).all(|(_, &d)| d == 0.0));
    let lowest = particles.positions.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    assert!(doubts().filter(|(p, _)| p.y < lowest + 0.004).all(|(_, &d)| d > 0.5));

    let points = filling.surface_mesh().sample(0.01, 0);
    let doubts_where = |chosen: &dyn Fn(&SurfacePoint) -> bool| -> Vec<f32> {
        points.iter().filter(|p| chosen(p)).map(|p| filling.doubt_of_surface(p.position)).collect()
    };
    let top = doubts_where(&|p| p.normal.y > 0.9 && p.position.x.abs() < 0.1 && p.position.z.abs() < 0.08);
    let underside = doubts_where(&|p| p.normal.y < -0.9);
    assert!(top.len() > 50 && top.iter().all(|d| *d == 0.0), "{top:?}");
    assert!(underside.len() > 50 && underside.iter().all(|d| *d > 0.9), "{underside:?}");

    // Seen from all sides, nothing is in doubt.
    let cameras = cameras();
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| mask(&body, c)).collect();
    let filling = fill(&perfect_gaussians(&body), &views(&cameras, &masks), &settings_for(&body)).unwrap();
    let seen = sample_particles(&filling, 0.01, &ParticleTuning::default()).unwrap();
    let mean = |doubts: &[f32]| doubts.iter().sum::<f32>() / doubts.len() as f32;
    println!("mean doubt: seen from above {:.3}, from all sides {:.3}", mean(&particles.doubts), mean(&seen.doubts));
    assert!(mean(&seen.doubts) < 0.1 * mean(&particles.doubts));
}

/// Noisy Gaussians and a quarter as many that no image decides about: below the ground, hidden by the others.
fn sunken(body: &Body, seed: u64) -> Gaussians {
    let mut gaussians = noisy_gaussians(body, seed);
    let Shape::Isotropic { scales } = &mut gaussians.shape else { unreachable!("noisy Gaussians are isotropic") };
    for i in (0..gaussians.positions.len()).step_by(4) {
        let [x, y, z] = gaussians.positions[i];
        gaussians.positions.push([0.8 * x, -0.5 * y - 0.02, 0.8 * z]);
        gaussians.opacities.push(0.9);
        gaussians.sh.push([0.0; 3]);
        scales.push(scales[i]);
    }
    gaussians
}

fn leave_out(gaussians: &mut Gaussians, out: impl Fn([f32; 3]) -> bool) {
    let kept: Vec<usize> = (0..gaussians.positions.len()).filter(|&i| !out(gaussians.positions[i])).collect();
    let Shape::Isotropic { scales } = &mut gaussians.shape else { unreachable!("these Gaussians are isotropic") };
    *scales = kept.iter().map(|&i| scales[i]).collect();
    gaussians.positions = kept.iter().map(|&i| gaussians.positions[i]).collect();
    gaussians.opacities = kept.iter().map(|&i| gaussians.opacities[i]).collect();
    gaussians.sh = kept.iter().map(|&i| gaussians.sh[i]).collect();
}

#[test]
fn missing_masks_and_ground_are_respected() {
    let body = sphere();
    let cameras = cameras();
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| mask(&body, c)).collect();
    let mut some: Vec<MaskedView> = views(&cameras, &masks);
    for view in some.iter_mut().step_by(2) {
        view.mask = None;
    }
    let mut settings = settings_for(&body);
    let filling = fill(&perfect_gaussians(&body), &some, &settings).unwrap();
    assert_eq!(filling.views_used, 10);
    println!("half of the views: volume {}", filling.volume() / body.volume);
    assert!((filling.volume() / body.volume - 1.0).abs() < 0.06, "{}", filling.volume() / body.volume);

    // A plane through the centre, seen from above: nothing is left below it.
    settings.ground = Some(Plane { point: DVec3::ZERO, normal: DVec3::Y });
    let above: Vec<MaskedView> = views(&cameras, &masks).into_iter().filter(|v| v.camera.centre.y > 0.0).collect();
    let half = fill(&perfect_gaussians(&body), &above, &settings).unwrap();
    println!("half below ground: volume {}", half.volume() / body.volume);
    assert!((half.volume() / body.volume - 0.5).abs() < 0.08, "{}", half.volume() / body.volume);

    for view in &mut some {
        view.mask = None;
    }
    assert!(matches!(fill(&perfect_gaussians(&body), &some, &settings), Err(ContinuumError::NoMasks { views: 20 })));
}

#[test]
fn unusable_input_is_an_error() {
    let body = sphere();
    let cameras = &cameras()[..4];
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| mask(&body, c)).collect();
    let settings = settings_for(&body);
    let good = perfect_gaussians(&body);
    let mut faint = good.clone();
    faint.opacities.fill(0.001);
    assert!(matches!(
        fill(&faint, &views(cameras, &masks), &settings),
        Err(ContinuumError::TooFewGaussians { kept: 0, .. })
    ));
    let mut nan = good.clone();
    nan.positions.iter_mut().for_each(|p| p[1] = f32::NAN);
    assert!(matches!(fill(&nan, &views(cameras, &masks), &settings), Err(ContinuumError::TooFewGaussians { .. })));
    let cut = vec![masks[0][1..].to_vec(); 4];
    assert!(matches!(fill(&good, &views(cameras, &cut), &settings), Err(ContinuumError::MaskSize { view: 0, .. })));
    let negative = FillSettings { grid_spacing: -1.0, ..settings.clone() };
    assert!(matches!(fill(&good, &views(cameras, &masks), &negative), Err(ContinuumError::Setting { .. })));
    let fine = FillSettings { grid_spacing: 1e-4, ..settings };
    assert!(matches!(
        fill(&good, &views(cameras, &masks), &fine),
        Err(ContinuumError::Geometry(GeometryError::TooManyVoxels { .. }))
    ));
}

#[test]
fn particles_share_the_volume_and_their_alpha_matches_the_masks() {
    let body = torus();
    let cameras = cameras();
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| mask(&body, c)).collect();
    let views = views(&cameras, &masks);
    let filling = fill(&perfect_gaussians(&body), &views, &settings_for(&body)).unwrap();
    let particles = sample_particles(&filling, 0.007, &ParticleTuning::default()).unwrap();
    let n = particles.positions.len() as f64;
    assert!((n * particles.volume / filling.volume() - 1.0).abs() < 1e-9);
    assert!((n * 0.007f64.powi(3) / filling.volume() - 1.0).abs() < 0.03, "the lattice counts the volume");
    for (p, &surface) in particles.positions.iter().zip(&particles.surface) {
        let depth = -(body.distance)(*p);
        assert!(depth > -0.004, "inside");
        assert!(surface || depth > 0.002, "what is not surface is deep: {depth}");
        assert!(!surface || depth < 0.016, "what is surface is not: {depth}");
    }
    let appearance = calibrate(&particles, &views, &Tuning::default()).unwrap();
    let agreements: Vec<_> =
        compare_with_masks(&particles, &appearance, &views).into_iter().map(Option::unwrap).collect();
    let mean = agreements.iter().map(|a| a.signed_area_error).sum::<f64>() / agreements.len() as f64;
    println!("{appearance:?}: area {mean:+.4}, worst IoU {:.4}", agreements.iter().map(|a| a.iou).fold(1.0, f64::min));
    assert!(mean.abs() < 0.005, "{mean}");
    // Images of 160 pixels: a body 70 pixels wide, where half a pixel all around is 3 % already.
    assert!(agreements.iter().all(|a| a.iou > 0.94));
    assert!(sample_particles(&filling, 0.0, &ParticleTuning::default()).is_err());
}

/// Grains lie anywhere in their own cells, with their own volumes, and the same seed lays them the same.
#[test]
fn particles_without_order_fill_the_same_cells() {
    let distance = |p: DVec3| p.abs().max_element() - 0.1;
    let filling = Filling::of_body((DVec3::splat(-0.12), DVec3::splat(0.12)), 0.005, 0.01, distance).unwrap();
    let ordered = sample_particles(&filling, 0.01, &ParticleTuning::default()).unwrap();
    let laid = ordered.clone().without_order(3);
    assert_eq!(laid, ordered.clone().without_order(3));
    assert_eq!(laid.volume_factors, ordered.volume_factors);
    let steps: Vec<DVec3> = laid.positions.iter().zip(&ordered.positions).map(|(a, b)| (*a - *b) / 0.01).collect();
    assert!(steps.iter().all(|step| step.abs().max_element() <= 0.5));
    let count = steps.len() as f64;
    let mean = steps.iter().sum::<DVec3>() / count;
    let square = steps.iter().map(|step| *step * *step).sum::<DVec3>() / count;
    assert!(mean.abs().max_element() < 4.0 * (1.0 / 12.0 / count).sqrt(), "{mean}");
    assert!((square * 12.0 - 1.0).abs().max_element() < 0.1, "evenly over the cell: {square}");
}

/// Mass and stiffness against bending of a plate, however many layers of particles fall inside.
#[test]
fn a_plate_of_broken_layers_has_its_mass_and_its_stiffness() {
    let (spacing, half_side) = (0.01, 0.1);
    for half_thickness in [0.0165, 0.0185, 0.022] {
        let distance = |p: DVec3| (p.x.abs() - half_side).max(p.z.abs() - half_side).max(p.y.abs() - half_thickness);
        let room = DVec3::new(0.12, 0.0425, 0.12);
        let filling = Filling::of_body((-room, room), 0.002, 0.004, distance).unwrap();
        let particles = sample_particles(&filling, spacing, &ParticleTuning::default()).unwrap();
        let within = |p: &DVec3| p.x.abs() < 0.08 && p.z.abs() < 0.08;
        let (mut volume, mut second) = (0.0, 0.0);
        for (p, factor) in particles.positions.iter().zip(&particles.volume_factors).filter(|(p, _)| within(p)) {
            let own = f64::from(*factor) * particles.volume;
            // A particle is spread over its share, a slice as high as its volume over that of a cell's base.
            second += own * (p.y * p.y + (own / spacing.powi(2)).powi(2) / 12.0);
            volume += own;
        }
        let thickness = volume / 0.16f64.powi(2);
        let stiffness = second / volume / ((2.0 * half_thickness).powi(2) / 12.0);
        println!(
            "half thickness {half_thickness}: {:.4} of its mass, {stiffness:.4} of its stiffness",
            0.5 * thickness / half_thickness
        );
        assert!((0.5 * thickness / half_thickness - 1.0).abs() < 0.02);
        assert!((stiffness - 1.0).abs() < 0.05);
        let mean = particles.volume_factors.iter().sum::<f32>() / particles.positions.len() as f32;
        assert!((mean - 1.0).abs() < 1e-3);
    }
}

#[test]
fn a_finer_drawing_agrees_better_with_the_masks_and_follows_the_particles() {
    let body = torus();
    let cameras = cameras();
    let masks: Vec<Vec<f32>> = cameras.iter().map(|c| mask(&body, c)).collect();
    let views = views(&cameras, &masks);
    let filling = fill(&perfect_gaussians(&body), &views, &settings_for(&body)).unwrap();
    let simulated = sample_particles(&filling, 0.014, &ParticleTuning::default()).unwrap();
    let drawing = Drawing::new(&filling, &simulated, 0.007, &ParticleTuning::default()).unwrap();
    let n = drawing.particles.positions.len();
    assert!(n > 7 * simulated.positions.len() && drawing.parents.len() == n);

    let worst = |particles: &Particles| {
        let appearance = calibrate(particles, &views, &Tuning::default()).unwrap();
        compare_with_masks(particles, &appearance, &views).iter().map(|a| a.unwrap().iou).fold(1.0, f64::min)
    };
    let (coarse, fine) = (worst(&simulated), worst(&drawing.particles));
    println!("worst IoU of particles 14 mm apart {coarse:.4}, of points 7 mm apart {fine:.4}");
    assert!(fine > coarse && 1.0 - fine < 0.75 * (1.0 - coarse));

    // At rest the points are where they were sampled; a body that moves and turns a little takes them along.
    assert!(drawing.offsets.iter().all(|o| o.length() < 0.014));
    for (p, q) in drawing.positions(&simulated.positions).iter().zip(&drawing.particles.positions) {
        assert!((*p - *q).length() < 1e-12);
    }
    let turn = |p: DVec3| DMat3::from_rotation_y(0.1) * p + DVec3::new(0.3, -0.2, 0.1);
    let moved: Vec<DVec3> = simulated.positions.iter().map(|&p| turn(p)).collect();
    for (p, q) in drawing.positions(&moved).iter().zip(&drawing.particles.positions) {
        assert!((*p - turn(*q)).length() < 0.1 * 0.014);
    }

    // The transpose: <g, J d> = <J^T g, d> for any g and d.
    let cotangent: Vec<DVec3> = (0..n).map(|i| DVec3::new((i as f64).sin(), (i as f64).cos(), 0.3)).collect();
    let ahead = drawing.positions(&moved);
    let start = drawing.positions(&simulated.positions);
    let forward: f64 = cotangent.iter().zip(ahead.iter().zip(&start)).map(|(g, (a, b))| g.dot(*a - *b)).sum();
    let pulled = drawing.pull_back(&cotangent, simulated.positions.len());
    let backward: f64 =
        pulled.iter().zip(moved.iter().zip(&simulated.positions)).map(|(g, (a, b))| g.dot(*a - *b)).sum();
    assert!((forward - backward).abs() < 1e-9 * forward.abs().max(1.0), "{forward} {backward}");
}

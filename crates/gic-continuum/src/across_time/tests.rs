use gic_scene::{Camera, Mask, Picture};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

use super::*;
use crate::test_cross::{CENTRE, VOLUME, cameras, cross, hit, turned};
use crate::{FillSettings, Filling, MirrorPlane};

const SPACING: f64 = 0.01;

/// Colours of the body's matter, under a light from above that turning matter is shaded by.
fn colour(material: DVec3, normal: DVec3) -> DVec3 {
    let wave = |k: DVec3| 0.5 + 0.35 * k.dot(material).sin();
    let albedo = DVec3::new(
        wave(DVec3::new(60.0, 35.0, 0.0)),
        wave(DVec3::new(0.0, 70.0, -40.0)),
        wave(DVec3::new(-45.0, 0.0, 65.0)),
    );
    albedo * (0.75 + 0.25 * normal.y)
}

/// Where a point of the first moment is in the `k`-th, as it tumbles.
fn tumbled(k: usize, p: DVec3) -> DVec3 {
    turn(k) * (p - CENTRE) + CENTRE
}

fn turn(k: usize) -> DQuat {
    DQuat::from_axis_angle(DVec3::new(0.6, 0.64, 0.48), 0.35 * k as f64)
}

/// A cross whose notches are filled up to a ball and whose faces are too far out.
fn swollen(p: DVec3) -> f64 {
    let (a, b) = (cross(p, DVec3::ZERO) - 0.006, (p - CENTRE).length() - 0.1);
    a.min(b)
}

/// On voxels of 8 mm.
fn filling(distance: impl Fn(DVec3) -> f64) -> Filling {
    filling_on_voxels(0.008, distance)
}

/// Side of the voxels that filling has by default for a body of that size [m].
fn default_voxel() -> f64 {
    FillSettings::for_size(0.32).finest_spacing()
}

fn filling_on_voxels(side: f64, distance: impl Fn(DVec3) -> f64) -> Filling {
    let half = DVec3::splat(0.22);
    Filling::of_body((CENTRE - half, CENTRE + half), side, 4.0 * side, distance).expect("a small grid")
}

fn particles(distance: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let axis = |i: usize| SPACING * (i as f64 - 18.0);
    let cube = (0..37usize.pow(3)).map(|i| CENTRE + DVec3::new(axis(i % 37), axis(i / 37 % 37), axis(i / 1369)));
    cube.filter(|p| distance(*p) < -0.5 * SPACING).collect()
}

/// Three cameras, with finer pictures than the other tests': a pixel is 5 mm wide.
fn fine_cameras() -> Vec<Camera> {
    let fine = |camera: Camera| Camera {
        width: 200,
        height: 200,
        focal: DVec2::splat(250.0),
        principal: DVec2::splat(100.0),
        ..camera
    };
    cameras().into_iter().map(fine).collect()
}

fn right(p: DVec3) -> f64 {
    cross(p, DVec3::ZERO)
}

/// What a camera sees of a body in the `k`-th moment.
fn seen(camera: &Camera, k: usize, body: impl Fn(DVec3) -> f64 + Sync) -> MomentView {
    let body = |p: DVec3| body(turn(k).inverse() * (p - CENTRE) + CENTRE);
    let (width, height) = (camera.width, camera.height);
    let middle = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
    let points: Vec<Option<DVec3>> =
        (0..width * height).into_par_iter().map(|i| hit(camera, middle(i), &body)).collect();
    let shown = |point: &Option<DVec3>| {
        let Some(point) = *point else { return [0.5; 3] };
        let slope = |axis: DVec3| body(point + 1e-3 * axis) - body(point - 1e-3 * axis);
        let normal = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).normalize_or_zero();
        colour(turn(k).inverse() * (point - CENTRE), normal).as_vec3().to_array()
    };
    let rgb = points.iter().flat_map(shown).collect();
    let coverage = points.iter().map(|point| f32::from(u8::from(point.is_some()))).collect();
    let view = MomentView::around_mask(camera, &Picture { width, height, rgb }, &Mask { width, height, coverage });
    view.expect("the body is in the picture")
}

fn views(k: usize, body: impl Fn(DVec3) -> f64 + Sync) -> Vec<MomentView> {
    fine_cameras().iter().map(|camera| seen(camera, k, &body)).collect()
}

/// Seven moments of a tumbling body, of which the motion that is known is behind by `error` [rad] a moment.
fn moments(body: &[DVec3], error: f64) -> Vec<Moment> {
    let moment = |k: usize| {
        let behind = DQuat::from_axis_angle(DVec3::new(0.0, 0.8, 0.6), -error * k as f64);
        let positions = body.iter().map(|p| behind * (tumbled(k, *p) - CENTRE) + CENTRE).collect();
        Moment { positions, flies: k == 0, views: views(k, right) }
    };
    (0..7).map(moment).collect()
}

/// Settles a body without mirror planes.
fn settle(body: &mut Filling, particles: &[DVec3], moments: &[Moment], stop: bool) -> Option<AcrossTime> {
    body.settle_across_time(
        (particles, SPACING),
        (moments, f64::INFINITY),
        &Symmetry::default(),
        &Tuning::default(),
        &|| stop,
    )
}

/// The volume over the true one, and the root mean square distance of the surface from the true one [m].
fn errors(filling: &Filling) -> (f64, f64) {
    let vertices = filling.surface_mesh().vertices;
    let squares: f64 = vertices.iter().map(|p| right(*p).powi(2)).sum();
    (filling.volume() / VOLUME - 1.0, (squares / vertices.len() as f64).sqrt())
}

/// Share of the surface that has colours or lies at an edge of a silhouette, whether that tells the place or not.
fn touched_share(body: &Filling, particles: &[DVec3], moments: &[Moment]) -> f64 {
    let tuning = Tuning::default();
    let observed = Observed::new(moments, (particles, SPACING), &tuning);
    let mut poses = vec![Pose::default(); moments.len()];
    let (surface, seen, _) = observed.look_at(body, &mut poses, true).expect("outlines are seen");
    let unit = Unit::new(0.0, body.field.spacing, tuning.iterations.most_rounds);
    let by_colours = wanted_by_colours(&surface, &seen, moments, &observed.pictures, (&unit, &tuning));
    let contours = seen.iter().flat_map(SeenMoment::points);
    let wanted = observed.wanted(&surface.mesh.vertices, (&by_colours, contours), &Symmetry::default(), &unit);
    wanted.iter().filter(|(_, weight)| *weight > 0.0).count() as f64 / wanted.len() as f64
}

/// Three cameras, and a motion that errs by 12 degrees at its end. Notches are filled deeper than colours agree around
/// their surface: only depths that lie far apart reach their ground.
#[test]
fn a_tumbling_body_is_seen_from_all_sides() {
    let mut body = filling(swollen);
    let particles = particles(swollen);
    let (before, moments) = (errors(&body), moments(&particles, 0.035));
    let found = settle(&mut body, &particles, &moments, false).expect("something is seen");
    let after = errors(&body);
    println!("{before:?} {after:?} {found:?}");
    assert!(before.0 > 0.5 && after.0.abs() < 0.15 * before.0, "volume {before:?} {after:?}");
    assert!(after.1 < 0.4 * before.1, "surface {before:?} {after:?}");
    assert!(found.gap_after_m < 0.5 * found.gap_before_m, "{found:?}");
    let touched = touched_share(&body, &particles, &moments);
    assert!(touched > 0.9 && found.seen > 0.85, "{touched} lie at edges or have colours, {found:?}");
}

/// One moment: places that look away from all cameras stay in doubt, and edges of silhouettes do not.
#[test]
fn what_no_picture_tells_is_in_doubt() {
    let mut body = filling(right);
    let particles = particles(right);
    let found = settle(&mut body, &particles, &moments(&particles, 0.0)[..1], false).expect("outlines are seen");
    let mesh = body.surface_mesh();
    let is_hidden = |p: &DVec3, n: &DVec3| fine_cameras().iter().all(|c| n.dot((c.centre - p).normalize()) < -0.2);
    let below = |p: DVec3, n: DVec3| body.field.discretize(p - 0.5 * body.field.spacing * n).expect("within the field");
    let doubts: Vec<(bool, f64)> = (mesh.vertices.iter().zip(&mesh.normals))
        .map(|(p, n)| (is_hidden(p, n), f64::from(body.doubt[below(*p, *n)])))
        .collect();
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let hidden = mean(doubts.iter().filter(|(is_hidden, _)| *is_hidden).map(|(_, doubt)| *doubt).collect());
    let all = mean(doubts.iter().map(|(_, doubt)| *doubt).collect());
    println!("hidden {hidden:.2}, all {all:.2}, told {:.2}", found.seen);
    assert!(hidden > 0.9 && (1.0 - all - found.seen).abs() < 0.05, "{hidden} {all}");
}

/// How far the places reach along the ray that make the outline in one picture: little of a ball, and all of a cone
/// that a camera takes for that ball.
#[test]
fn an_outline_tells_no_place_of_what_runs_along_the_ray() {
    let camera = &fine_cameras()[0];
    let (towards, away) = ((CENTRE - camera.centre).normalize(), CENTRE.distance(camera.centre));
    let ball = |p: DVec3| p.distance(CENTRE) - 0.1;
    let cone = |p: DVec3| {
        let (along, slope) = ((p - camera.centre).dot(towards), (0.1 / away).asin());
        let beside = (p - camera.centre - along * towards).length();
        (beside * slope.cos() - along * slope.sin()).max((along - away).abs() - 0.15)
    };
    let moment = Moment { positions: particles(ball), flies: true, views: vec![seen(camera, 0, ball)] };
    let outlines = MomentOutlines::new(&moment);
    let median_of = |distance: &dyn Fn(DVec3) -> f64| {
        let (body, particles) = (filling(distance), particles(distance));
        let surface = TrackedSurface::new(body.surface_mesh(), &particles, SPACING);
        let contour = outlines.contour(&surface.carried(&particles).moved(&Pose::default()));
        median(contour::extents(&contour, body.field.spacing / 0.005)).expect("an outline is seen")
    };
    let (of_ball, of_cone) = (median_of(&ball), median_of(&cone));
    assert!(of_ball < 0.02 && of_cone > 0.25, "{of_ball} {of_cone}");
}

/// A limb that is not there: its outlines lie far outside of all masks. The motion errs by six degrees at its end.
#[test]
fn a_limb_that_no_mask_shows_is_taken_away() {
    let with_limb = |p: DVec3| {
        let own = turned().inverse() * (p - CENTRE);
        let along = own.dot(DVec3::ONE).clamp(0.0, 0.3) / 3.0;
        right(p).min((own - along * DVec3::ONE).length() - 0.03)
    };
    let mut body = filling_on_voxels(default_voxel(), with_limb);
    let particles = particles(with_limb);
    let before = errors(&body);
    settle(&mut body, &particles, &moments(&particles, 0.0175), false).expect("something is seen");
    let after = errors(&body);
    println!("{before:?} {after:?}");
    assert!(before.0 > 0.05 && after.0.abs() < 0.2 * before.0, "volume {before:?} {after:?}");
    assert!(after.1 < 0.2 * before.1, "surface {before:?} {after:?}");
}

/// The motion misses that an arm bends out of the place where it has it. The flight shows the arm, and it stays.
#[test]
fn a_part_that_the_flight_shows_stays() {
    let tip = |p: DVec3| (turned().inverse() * (p - CENTRE)).x - 0.12;
    let mut body = filling(right);
    let particles = particles(right);
    let mut moments = moments(&particles, 0.0);
    for (k, moment) in moments.iter_mut().enumerate().skip(3) {
        moment.views = views(k, |p| right(p).max(tip(p)));
    }
    let before = errors(&body);
    settle(&mut body, &particles, &moments, false).expect("something is seen");
    let after = errors(&body);
    println!("{before:?} {after:?}");
    // The tip is 6 % of the volume.
    assert!((after.0 - before.0).abs() < 0.02, "{before:?} {after:?}");
}

/// What is right stays. On the voxels that filling has by default: coarser ones cut off the edges that make outlines.
#[test]
fn a_body_that_fits_its_pictures_keeps_its_volume() {
    let mut body = filling_on_voxels(default_voxel(), right);
    let particles = particles(right);
    let before = errors(&body);
    settle(&mut body, &particles, &moments(&particles, 0.0), false).expect("something is seen");
    let after = errors(&body);
    println!("{before:?} {after:?}");
    assert!((after.0 - before.0).abs() < 0.015, "{before:?} {after:?}");
}

/// A motion that carries the body out of all pictures tells nothing of it, and the body stays as it is.
#[test]
fn a_body_that_leaves_the_pictures_stays() {
    let mut body = filling(swollen);
    let (particles, before) = (particles(swollen), body.field.values.clone());
    let mut moments = moments(&particles, 0.0);
    let away = |moment: &mut Moment| moment.positions.iter_mut().for_each(|p| *p += DVec3::new(0.0, 50.0, 0.0));
    moments.iter_mut().for_each(away);
    let found = settle(&mut body, &particles, &moments, false);
    assert!(found.is_none(), "{found:?}");
    assert_eq!(body.field.values, before);
}

/// What one octant of a body with three mirror planes wants, all eight want.
#[test]
fn mirror_images_share_what_they_want() {
    let body = filling(right);
    let planes = DVec3::AXES.iter().map(|axis| {
        let normal = turned() * *axis;
        MirrorPlane { normal, offset: normal.dot(CENTRE), misfit: 0.0 }
    });
    let symmetry = Symmetry { planes: planes.collect(), interchangeable_planes: Vec::new() };
    let vertices = body.surface_mesh().vertices;
    let is_seen = |p: &DVec3| (turned().inverse() * (*p - CENTRE)).min_element() > 0.0;
    let mut wanted: Vec<(f64, f64)> =
        vertices.iter().map(|p| if is_seen(p) { (0.7, 2.0) } else { (0.0, 0.0) }).collect();
    let seen = wanted.iter().filter(|(_, weight)| *weight > 0.0).count();
    share_with_images(&mut wanted, &vertices, &symmetry, body.field.spacing);
    let told = wanted.iter().filter(|(at, weight)| (at - 0.7).abs() < 1e-9 && *weight >= 2.0).count();
    assert!(seen < vertices.len() / 6 && told > vertices.len() * 9 / 10, "{seen}, then {told} of {}", vertices.len());
}

#[test]
fn who_is_stopped_says_nothing() {
    let mut body = filling(swollen);
    let particles = particles(swollen);
    let moments = moments(&particles, 0.0);
    assert_eq!(settle(&mut body, &particles, &moments, true), None);
}

/// The pose that undoes an error of the motion is found.
#[test]
fn poses_undo_what_the_motion_errs() {
    let (body, particles) = (filling(right), particles(right));
    let moments = moments(&particles, 0.05);
    let outlines: Vec<MomentOutlines> = moments.iter().map(MomentOutlines::new).collect();
    let surface = TrackedSurface::new(body.surface_mesh(), &particles, SPACING);
    let mut poses = vec![Pose::default(); moments.len()];
    let carried: Vec<CarriedSurface> = moments.iter().map(|moment| surface.carried(&moment.positions)).collect();
    pose_fit::first(&mut poses, &carried, &moments, &outlines);
    for (k, pose) in poses.iter().enumerate() {
        let behind = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.0, 0.8, 0.6), -0.05 * k as f64));
        let left = DQuat::from_mat3(&(pose.turn * behind)).to_scaled_axis().length();
        // Two thirds of a pixel at the ends of the arms.
        assert!(left < 0.02, "moment {k}: {left} rad left of {}", 0.05 * k as f64);
    }
}

//! Elastic waves: the speed in a bar and the frequency of a cantilever, at two resolutions.
//!
//! The finest one is long: `cargo test --release -p gic-mpm --test validation_waves -- --include-ignored --nocapture`.

mod common;

use std::f64::consts::PI;

use common::{DENSITY, block, body, first_return_to_zero, next, set_velocities, simulator, world};
use gic_mpm::{Collider, Contact, Material, World};
use glam::DVec3;

const YOUNG: f64 = 1e5;

/// No lateral contraction: a bar's waves then travel at exactly sqrt(E / rho), whatever its section.
fn material() -> Material {
    Material::Elastic { youngs_modulus_pa: YOUNG, poisson_ratio: 0.0 }
}

fn without_gravity(world: World) -> World {
    World { gravity_m_s2: DVec3::ZERO, ..world }
}

/// Speed [m/s] from the fundamental longitudinal vibration of a free bar, `c = 2 L f`: started with the mode's
/// velocity, the mode's displacement vanishes again after half a period.
fn wave_speed_in_a_bar(cells: usize) -> f64 {
    let length = 0.4;
    let dx = length / cells as f64;
    let positions = block(DVec3::ZERO, DVec3::new(length, 2.0 * dx, 2.0 * dx), dx);
    let exact = (YOUNG / DENSITY).sqrt();
    let half_period = length / exact;
    let rate = 40.0 / half_period;
    let world = without_gravity(world(body(material(), positions.clone(), dx), vec![], dx, rate));
    let mode = |x: DVec3| (PI * x.x / length).cos();
    let mut simulator = simulator(&world);
    // Strains of 0.1 %.
    set_velocities(&mut simulator, |x| DVec3::X * (mode(x) * 1e-3 * exact));
    let displacement = |now: &[DVec3]| positions.iter().zip(now).map(|(x, now)| mode(*x) * (now.x - x.x)).sum::<f64>();
    let signal: Vec<f64> = (0..60)
        .map(|frame| displacement(&if frame == 0 { positions.clone() } else { next(&mut simulator).positions }))
        .collect();
    length / first_return_to_zero(&signal, 1.0 / rate).expect("the bar vibrates")
}

#[test]
fn elastic_wave_in_a_bar_travels_at_its_speed_and_converges() {
    let exact = (YOUNG / DENSITY).sqrt();
    let errors = [10, 20, 40].map(|cells| {
        let found = wave_speed_in_a_bar(cells);
        println!(
            "bar of {cells} cells: {found:.4} m/s, exact {exact:.4}, error {:+.2} %",
            100.0 * (found / exact - 1.0)
        );
        (found / exact - 1.0).abs()
    });
    assert!(errors[1] <= 0.05 && errors[2] <= 0.05, "{errors:?}");
    assert!(errors[0] > errors[1] && errors[1] > errors[2], "must converge: {errors:?}");
}

/// Fundamental angular frequency [rad/s] of a clamped-free Timoshenko beam of square section (Huang 1961, eq. 36):
/// slender-beam theory is off by several per cent for a beam six times as long as high.
fn timoshenko_frequency(length: f64, height: f64) -> f64 {
    let shear_modulus = YOUNG / 2.0;
    // Shear coefficient of a rectangle without lateral contraction.
    let kappa = 5.0 / 6.0;
    let r2 = height * height / 12.0 / (length * length);
    let s2 = r2 * YOUNG / (kappa * shear_modulus);
    let characteristic = |b: f64| {
        let root = ((r2 - s2).powi(2) + 4.0 / (b * b)).sqrt();
        let (alpha, beta) = (((root - (r2 + s2)) / 2.0).sqrt(), ((root + (r2 + s2)) / 2.0).sqrt());
        let (ba, bb) = (b * alpha, b * beta);
        2.0 + (b * b * (r2 - s2).powi(2) + 2.0) * ba.cosh() * bb.cos()
            - b * (r2 + s2) / (1.0 - b * b * r2 * s2).sqrt() * ba.sinh() * bb.sin()
    };
    // b is 3.516 for a slender beam; shear and rotary inertia lower it.
    let (mut low, mut high) = (1.0, 3.6);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if characteristic(low) * characteristic(middle) <= 0.0 { high = middle } else { low = middle }
    }
    low * (YOUNG * r2 / DENSITY).sqrt() / length
}

#[test]
fn timoshenko_beam_tends_to_the_slender_one() {
    let slender = 3.516015 * (YOUNG / (12.0 * DENSITY)).sqrt() * 0.001;
    assert!((timoshenko_frequency(1.0, 0.001) / slender - 1.0).abs() < 1e-4);
    assert!(timoshenko_frequency(1.0, 1.0 / 6.0) < slender / 0.001 / 6.0);
}

/// Angular frequency [rad/s] of a cantilever clamped at x = 0, `cells` high: started with the velocity of the slender
/// beam's first mode.
fn cantilever_frequency(cells: usize) -> f64 {
    let (length, height) = (0.6, 0.1);
    let dx = height / cells as f64;
    let positions = block(DVec3::ZERO, DVec3::new(length, height, 2.0 * dx), dx);
    let exact = timoshenko_frequency(length, height);
    let rate = 40.0 * exact / PI;
    let clamp = Collider::plane(DVec3::ZERO, DVec3::X, Contact::Sticky);
    let world = without_gravity(world(body(material(), positions.clone(), dx), vec![clamp], dx, rate));
    let shape = |x: DVec3| {
        let (k, ratio) = (1.875104 / length, 0.734096);
        (k * x.x).cosh() - (k * x.x).cos() - ratio * ((k * x.x).sinh() - (k * x.x).sin())
    };
    let mut simulator = simulator(&world);
    set_velocities(&mut simulator, |x| DVec3::Y * (shape(x) * 0.005 * length * exact));
    let displacement = |now: &[DVec3]| positions.iter().zip(now).map(|(x, now)| shape(*x) * (now.y - x.y)).sum::<f64>();
    let signal: Vec<f64> = (0..60)
        .map(|frame| displacement(&if frame == 0 { positions.clone() } else { next(&mut simulator).positions }))
        .collect();
    PI / first_return_to_zero(&signal, 1.0 / rate).expect("the beam vibrates")
}

fn check_cantilever(resolutions: &[usize], finest_within: f64) {
    let exact = timoshenko_frequency(0.6, 0.1);
    let errors: Vec<f64> = resolutions
        .iter()
        .map(|&cells| {
            let found = cantilever_frequency(cells);
            let error = found / exact - 1.0;
            println!(
                "cantilever {cells} cells high: {found:.4} rad/s, exact {exact:.4}, error {:+.2} %",
                100.0 * error
            );
            error.abs()
        })
        .collect();
    assert!(errors.windows(2).all(|pair| pair[0] > pair[1]), "must converge: {errors:?}");
    assert!(errors[errors.len() - 1] <= finest_within, "{errors:?}");
}

#[test]
fn cantilever_vibrates_at_its_frequency_and_converges() {
    check_cantilever(&[2, 4], 0.05);
}

#[test]
#[ignore = "10 s of CPU; see the top of this file"]
fn cantilever_converges_further() {
    check_cantilever(&[2, 4, 8], 0.02);
}

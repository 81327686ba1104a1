//! `gic grasp` from outside, and its forces against closed forms.
//!
//! The longer ones: `cargo test --release -p gic --test grasp -- --include-ignored --nocapture`.

#[path = "common/case.rs"]
mod case;
mod common;

use std::fs;
use std::path::Path;
use std::process::Output;

use gic_grasp::{AxisChoice, GraspReport, GraspRequest, Gripper, grasp};
use gic_twin::events::Events;
use gic_twin::{Interrupt, matter};
use glam::DVec3;
use serde_json::{Value, json};

use case::Case;
use common::gic;

const YOUNG: f64 = 1e5;
const POISSON: f64 = 0.3;

/// A weightless elastic twin of a shape or file.
fn twin(continuum: Value, grid_spacing_m: f64) -> Value {
    json!({
        "schema": "gic.twin/1",
        "material": {"model": "elastic", "youngs_modulus_pa": YOUNG, "poisson_ratio": POISSON},
        "density_kg_m3": 1000.0,
        "gravity_m_s2": [0, 0, 0],
        "grid_spacing_m": grid_spacing_m,
        "continuum": continuum
    })
}

fn block(size_m: [f64; 3]) -> Value {
    json!({"shape": "box", "size_m": size_m, "centre_m": [0.1, 0.2, 0.3]})
}

impl Case {
    /// Squeezes along x, without pictures.
    fn squeeze(&self, twin: &Value, widths_m: &[f64], gripper: Gripper) -> GraspReport {
        let request = GraspRequest {
            twin: self.write(twin),
            settings: Vec::new(),
            widths_m: widths_m.to_vec(),
            axis: AxisChoice::World(0),
            gripper,
            refine: None,
            out: self.path("grasp"),
            pictures: false,
            size: [64, 64],
            budget: gic_mpm::Budget::default(),
            film: self.path("film.gif"),
        };
        grasp(&request, &Events::silent(), &Interrupt::default()).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Runs the program, which must fail; its message.
    fn refusal(&self, twin: &Value, args: &[&str]) -> String {
        let output = self.run(twin, args);
        assert!(!output.status.success(), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    }

    fn run(&self, twin: &Value, args: &[&str]) -> Output {
        let twin = self.write(twin);
        gic(&[&["grasp", twin.to_str().unwrap()], args].concat())
    }
}

/// Frictionless plates larger than the object.
fn plates() -> Gripper {
    Gripper { pad_m: [0.2, 0.2], friction: 0.0, lift_m: 0.05 }
}

fn assert_balanced(report: &GraspReport) {
    for w in &report.widths {
        assert!(w.imbalance.abs() < 0.02, "{w:?}");
        assert!(w.force_spread_n < 0.02 * w.force_n, "{w:?}");
    }
}

/// Force [N] on a neo-Hookean bar of section `area` [m^2] at the stretch `along`, free to swell: tau = mu F F^T +
/// (lambda ln J - mu) I with tau = 0 across gives the stretch across; the force is area * tau_xx / along.
fn bar_force(area: f64, along: f64) -> f64 {
    let (mu, lambda) = (YOUNG / (2.0 * (1.0 + POISSON)), YOUNG * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON)));
    let across_stress = |b: f64| mu * (b * b - 1.0) + lambda * (along * b * b).ln();
    let (mut low, mut high) = (0.5, 2.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if across_stress(middle) < 0.0 { low = middle } else { high = middle }
    }
    -area * (mu * (along * along - 1.0) + lambda * (along * low * low).ln()) / along
}

#[test]
fn a_grasp_over_its_budget_is_refused_before_it_starts() {
    let twin = twin(block([0.06, 0.03, 0.03]), 0.005);
    let message = Case::new().refusal(&twin, &["--width-m", "0.055", "--budget-hours", "1e-6"]);
    for part in ["hours", "--budget-hours", "--budget-gb"] {
        assert!(message.contains(part), "`{part}` is missing in {message}");
    }
}

/// Cells along a block of 60 mm x 30 mm x 30 mm, and its strains and force ratios.
fn block_errors(cells: f64) -> Vec<(f64, f64)> {
    let (length, side) = (0.06, 0.03);
    let dx = length / cells;
    let report = Case::new().squeeze(&twin(block([length, side, side]), dx), &[0.0585, 0.0575], plates());
    assert_balanced(&report);
    assert!((report.object_width_m - length).abs() < 1e-6);
    let of = |w: &gic_grasp::Squeeze| {
        let strain = 1.0 - w.measured_width_m / length;
        let hooke = YOUNG * side * side * strain;
        let exact = bar_force(side * side, 1.0 - strain);
        println!(
            "{cells} cells, strain {:.3} %: {:.4} N, E A strain {hooke:.4} ({:+.2} %), neo-Hookean bar {exact:.4} \
             ({:+.2} %)",
            100.0 * strain,
            w.force_n,
            100.0 * (w.force_n / hooke - 1.0),
            100.0 * (w.force_n / exact - 1.0)
        );
        (w.force_n / hooke - 1.0, w.force_n / exact - 1.0)
    };
    report.widths.iter().map(of).collect()
}

#[test]
fn a_block_between_plates_follows_hooke() {
    let tiny = bar_force(1.0, 1.0 - 1e-6) / (YOUNG * 1e-6);
    assert!((tiny - 1.0).abs() < 1e-4, "the exact bar is Hooke's at small strains: {tiny}");
    for (hooke, _) in block_errors(12.0) {
        assert!(hooke.abs() <= 0.05, "{hooke}");
    }
}

/// A ball as filling places particles: on a lattice, the outermost two layers moved to their middles.
fn ball(path: &Path, radius: f64, grid_spacing_m: f64) -> f64 {
    let step = 0.5 * grid_spacing_m;
    let n = (radius / step).ceil() as i64 + 1;
    let mut rows = Vec::new();
    for i in -n..n {
        for j in -n..n {
            for k in -n..n {
                let p = DVec3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5);
                let depth = radius / step - p.length();
                let moved = match depth {
                    d if d < 0.0 => continue,
                    d if d < 1.0 => 0.5,
                    d if d < 2.0 => 0.5 * (d + 1.5),
                    d => d,
                };
                rows.push((p.normalize() * (radius - moved * step)).as_vec3().to_array());
            }
        }
    }
    matter::write_particles(path, ["x", "y", "z"], rows.iter().copied()).unwrap();
    (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3) / rows.len() as f64).cbrt()
}

/// Force over Hertz's for a ball of so many cells a radius, squeezed by `share` of its radius on each side.
fn hertz_ratio(cells: f64, share: f64) -> f64 {
    let radius = 0.04;
    let case = Case::new();
    let dx = radius / cells;
    let mut twin = twin(json!("ball.ply"), dx);
    twin["particle_spacing_m"] = json!(ball(&case.path("ball.ply"), radius, dx));
    let report = case.squeeze(&twin, &[2.0 * radius * (1.0 - share)], plates());
    assert_balanced(&report);
    let depth = radius * share;
    let hertz = 4.0 / 3.0 * YOUNG / (1.0 - POISSON * POISSON) * radius.sqrt() * depth.powf(1.5);
    let w = &report.widths[0];
    println!(
        "{cells} cells a radius, {:.1} % of it on each side (contact of {:.1} cells): {:.4} N, Hertz {hertz:.4} \
         ({:+.2} %), standoff {:.2} cells",
        100.0 * share,
        (radius * depth).sqrt() / dx,
        w.force_n,
        100.0 * (w.force_n / hertz - 1.0),
        w.standoff_m / dx
    );
    w.force_n / hertz
}

#[test]
#[ignore = "minutes of CPU; see the top of this file"]
fn a_ball_between_plates_follows_hertz_and_converges() {
    let errors = [5.0, 10.0, 20.0].map(|cells| (hertz_ratio(cells, 0.06) - 1.0).abs());
    assert!(errors[2] <= 0.15, "{errors:?}");
    assert!(errors[0] > errors[1] && errors[1] > errors[2], "must converge: {errors:?}");
}

#[test]
#[ignore = "a minute of CPU; see the top of this file"]
fn a_block_between_plates_converges() {
    // The limit is 3 % below the bar: the width is measured on particles. What must shrink is how far refining moves
    // the force.
    let errors = [6.0, 12.0, 24.0].map(|cells| block_errors(cells)[0].1);
    let moves = [(errors[1] - errors[0]).abs(), (errors[2] - errors[1]).abs()];
    assert!(moves[1] < 0.5 * moves[0], "must converge: {errors:?}");
    assert!(errors[2].abs() <= 0.05, "{errors:?}");
}

#[test]
fn friction_decides_whether_it_is_lifted() {
    let mut twin = twin(block([0.04, 0.05, 0.04]), 0.008);
    twin["gravity_m_s2"] = json!([0, -9.8, 0]);
    let pad_m = [0.03, 0.04];
    let case = Case::new();
    let lift = |friction: f64| {
        let report = case.squeeze(&twin, &[0.036], Gripper { pad_m, friction, lift_m: 0.05 });
        assert_balanced(&report);
        report.widths[0].lift.clone().unwrap()
    };
    let held = lift(0.6);
    println!("friction 0.6: {held:?}");
    assert!(!held.dropped && held.slip_m < 0.002, "{held:?}");
    assert!((held.carried_share - 1.0).abs() < 0.05, "the pads carry its weight: {held:?}");
    let left = lift(0.01);
    println!("friction 0.01: {left:?}");
    assert!(left.dropped && left.slip_m > 0.02, "{left:?}");
}

#[test]
fn plasticine_yields_under_the_pads_and_elastic_matter_does_not() {
    let mut soft = twin(block([0.04, 0.04, 0.04]), 0.01);
    let case = Case::new();
    let elastic = case.squeeze(&soft, &[0.034], plates());
    assert_eq!(elastic.widths[0].yielded_share, None);
    soft["material"] =
        json!({"model": "plasticine", "youngs_modulus_pa": YOUNG, "poisson_ratio": POISSON, "yield_stress_pa": 2e3});
    let plastic = case.squeeze(&soft, &[0.034], plates());
    assert!(plastic.widths[0].yielded_share.unwrap() > 0.0);
    let limit = plastic.yield_von_mises_pa.unwrap();
    assert!((limit / 2e3 - 1.5f64.sqrt()).abs() < 1e-12);
    assert!(plastic.widths[0].force_n < elastic.widths[0].force_n);
    soft["material"]["yield_stress_pa"] = json!(1e7);
    assert_eq!(case.squeeze(&soft, &[0.034], plates()).widths[0].yielded_share, Some(0.0));
}

#[test]
fn the_program_writes_a_table_numbers_pictures_and_a_film() {
    let case = Case::new();
    let mut twin = twin(block([0.05, 0.05, 0.04]), 0.01);
    twin["gravity_m_s2"] = json!([0, -9.8, 0]);
    let args = ["--width-m", "0.046,0.048", "--pad", "0.03x0.03", "--size", "96x72"];
    let output = case.run(&twin, &args);
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    for part in ["force - N", "48.00", "46.00", "held", "grasp"] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
    let report: GraspReport = serde_json::from_slice(&fs::read(case.path("grasp/grasp.json")).unwrap()).unwrap();
    assert_eq!(report.widths.iter().map(|w| w.width_m).collect::<Vec<_>>(), [0.048, 0.046]);
    assert!(report.widths[1].force_n > report.widths[0].force_n);
    assert!(report.widths.iter().all(|w| w.contact_areas_m2.iter().all(|&area| area > 0.5 * 0.03 * 0.03)));
    assert_eq!(report.axis, "auto");
    assert!(report.axis_direction[1].abs() < 0.3, "level: {:?}", report.axis_direction);
    for file in ["width_48.0mm.png", "width_46.0mm.png", "grasp.gif"] {
        assert!(case.path("grasp").join(file).is_file(), "{file}");
    }
    let mut names: Vec<String> = fs::read_dir(case.path("grasp"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["grasp.gif", "grasp.json", "width_46.0mm.png", "width_48.0mm.png"], "nothing else is left");
    // The table is chequered grey below; above is sky.
    let picture = image::open(case.path("grasp/width_48.0mm.png")).unwrap().to_rgb8();
    let grey = |x: u32, y: u32| picture.get_pixel(x, y).0;
    assert!(grey(2, 70)[0] < grey(2, 2)[0] && grey(2, 70)[0] == grey(2, 70)[2], "{:?} {:?}", grey(2, 70), grey(2, 2));
    let first = fs::read(case.path("grasp/grasp.json")).unwrap();
    assert!(case.run(&twin, &[&args[..], &["--no-pictures"]].concat()).status.success());
    assert_eq!(first, fs::read(case.path("grasp/grasp.json")).unwrap(), "the same numbers again");
}

/// The default pads are the fingertips of a real gripper, which a grid for a whole object is too coarse to feel.
#[test]
fn fingertips_refine_the_grid_until_it_feels_them() {
    let case = Case::new();
    let report = case.squeeze(&twin(block([0.06, 0.06, 0.06]), 0.02), &[0.057], Gripper::default());
    assert!((report.grid_spacing_m - 0.01).abs() < 1e-12, "{}", report.grid_spacing_m);
    assert!(report.widths[0].force_n > 0.0, "{}", report.widths[0].force_n);
}

#[test]
fn bad_input_is_explained() {
    let case = Case::new();
    let elastic = twin(block([0.05, 0.05, 0.04]), 0.01);
    let says = |twin: &Value, args: &[&str], parts: &[&str]| {
        let message = case.refusal(twin, args);
        for part in parts {
            assert!(message.contains(part), "`{part}` is missing in:\n{message}");
        }
    };
    says(&elastic, &["--width-m", "0"], &["cannot close to 0 m", "hint"]);
    says(&elastic, &["--width-m", "0.04,-0.01"], &["cannot close to -0.01 m"]);
    says(&elastic, &["--width-m", "0.2", "--axis", "x", "--pad", "0.03x0.03"], &["0.0500 m wide", "0.2 m"]);
    says(&elastic, &["--width-m", "0.2", "--pad", "0.03x0.03"], &["at least 0.2 m apart", "hint"]);
    says(&elastic, &["--width-m", "0.04", "--axis", "w"], &["`w` is no axis", "auto, x, y or z"]);
    says(&elastic, &["--width-m", "0.04", "--pad", "0.001x0.002"], &["grid cells", "--refine"]);
    says(&elastic, &["--width-m", "0.04", "--film", "film.avi"], &["avi", ".gif"]);
    let mut fluid = elastic.clone();
    fluid["material"] = json!({"model": "newtonian", "viscosity_pa_s": 5.0, "bulk_modulus_pa": 1e5});
    says(&fluid, &["--width-m", "0.04"], &["newtonian", "a fluid", "can be gripped"]);
    fluid["material"] = json!({"model": "sand", "friction_angle_deg": 30.0});
    says(&fluid, &["--width-m", "0.04"], &["sand", "grains"]);
    let ring = twin(json!({"shape": "torus", "major_radius_m": 0.1, "minor_radius_m": 0.02}), 0.01);
    says(&ring, &["--width-m", "0.03", "--axis", "y", "--pad", "0.03x0.03"], &["no matter between the pads"]);
    says(&twin(json!("missing.ply"), 0.01), &["--width-m", "0.04"], &["cannot read", "missing.ply"]);
    let output = gic(&["grasp", "/nowhere/twin.json", "--width-m", "0.04"]);
    assert!(String::from_utf8(output.stderr).unwrap().contains("/nowhere/twin.json"));
}

//! Identifies scenes of the PAC-NeRF layout whose truth is known, from given particles at time 0 and the scene's masks,
//! and prints estimates beside the truth. `cargo run --release --example validate -- MODE SCENE [PARTICLES]`:
//! - MODE `forward`: position error of a rollout with the true parameters, per frame;
//! - MODE `masks`, `surfaces`, `both`, `adam`: identification; surfaces are the true outer particles.
//!
//! PARTICLES is a file of little-endian f32 triples, spacing 0.01 m; without it the true particles are used.

mod common;

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use gic_identify::{Checkpoint, Event, Input, Optimizer, Settings, Target, identify, sought_values};
use glam::DVec3;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (mode, folder) = (arguments[0].as_str(), Path::new(&arguments[1]));
    let truth = common::truth(folder);
    let positions = arguments.get(2).map_or_else(|| common::particles(folder, 0), |path| read_triples(path));
    let mut input = common::input(folder, positions, 1e-6);
    if mode == "forward" {
        return forward(&input, folder, &truth);
    }
    let target = match mode {
        "masks" => Target::Masks,
        "surfaces" => Target::Surfaces,
        _ => Target::Both,
    };
    if target != Target::Masks {
        let outer = common::outer(&common::particles(folder, 0));
        for (frame, observation) in input.observations.iter_mut().enumerate() {
            let all = common::particles(folder, frame);
            observation.surface = outer.iter().map(|i| all[*i]).collect();
        }
    }
    let optimizer = if mode == "adam" { Optimizer::Adam } else { Optimizer::LevenbergMarquardt };
    let settings = Settings { target, optimizer, adam_iterations: 100, ..Settings::default() };
    let kind = truth.material.kind();
    let clock = Instant::now();
    let found = identify(&input, kind, &settings, Checkpoint::default(), &mut |event| {
        if let Event::Step(s) = event {
            eprintln!(
                "{:?} {} {:.4e} {:.5?} {:.4} {} {:.0}s",
                s.stage, s.iteration, s.objective, s.values, s.velocity_m_s, s.rollouts, s.seconds
            );
        }
        ControlFlow::Continue(())
    })
    .expect("identified");
    println!(
        "| {} | {mode} | {} rollouts + {} coarse | {:.0} s |",
        arguments[1],
        found.rollouts,
        found.coarse_rollouts,
        clock.elapsed().as_secs_f64()
    );
    for (e, t) in found.estimates.iter().zip(sought_values(&truth.material)) {
        println!(
            "| {} | {:.5e} | [{:.4e}, {:.4e}] {} | {t:.5e} | error {:+.4} | inside {} |",
            e.parameter.name,
            e.value,
            e.interval_95.0,
            e.interval_95.1,
            e.identifiable,
            e.parameter.error(e.value, t),
            e.interval_95.0 <= t && t <= e.interval_95.1
        );
    }
    let mean_factor = found.volume_factors.iter().sum::<f64>() / found.volume_factors.len().max(1) as f64;
    println!(
        "| velocity | {:.4} +- {:.4?} | error {:+.4} | volume x {:.4} splat {:.3} free {} | {:?} | {:?} |",
        found.velocity_m_s,
        found.velocity_interval_95,
        found.velocity_m_s - truth.velocity_m_s,
        mean_factor,
        found.splat_factor,
        found.free_frames,
        found.loss,
        found.seconds
    );
    for warning in &found.warnings {
        println!("  warning: {warning}");
    }
}

fn read_triples(path: &str) -> Vec<DVec3> {
    let bytes = std::fs::read(path).expect("particles file");
    let value = |i: usize| f64::from(f32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap()));
    (0..bytes.len() / 12).map(|i| DVec3::new(value(3 * i), value(3 * i + 1), value(3 * i + 2))).collect()
}

fn forward(input: &Input, folder: &Path, truth: &common::Truth) {
    let world = gic_mpm::World {
        bodies: vec![gic_mpm::Body {
            material: truth.material,
            density_kg_m3: 1000.0,
            particle_volume_m3: 1e-6,
            volume_factors: Vec::new(),
            positions: input.positions.clone(),
            velocity_m_s: truth.velocity_m_s,
            angular_velocity_rad_s: DVec3::ZERO,
            own_velocities_m_s: Vec::new(),
        }],
        colliders: input.colliders.clone(),
        gravity_m_s2: input.gravity_m_s2,
        grid_spacing_m: 0.02,
        frame_rate_hz: 24.0,
        stepping: gic_mpm::Stepping::at_least(200),
    };
    for rules in [gic_mpm::Rules::Reference, gic_mpm::Rules::Exact] {
        let clock = Instant::now();
        let options = gic_mpm::Options { rules, ..Default::default() };
        gic_mpm::rollout(&world, &options, 14, |frame| {
            let errors: Vec<f64> = common::particles(folder, frame.index)
                .iter()
                .zip(&frame.positions)
                .map(|(a, b)| a.distance(*b))
                .collect();
            if frame.index % 7 == 0 || frame.index == 13 {
                let (max, mean) =
                    (errors.iter().copied().fold(0.0, f64::max), errors.iter().sum::<f64>() / errors.len() as f64);
                println!("{} {rules:?} frame {} max {max:.2e} mean {mean:.2e}", folder.display(), frame.index);
            }
        })
        .expect("a rollout");
        println!("{:?}", clock.elapsed());
    }
}

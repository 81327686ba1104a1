//! The page of a twin, and the module in it.

use std::path::Path;

use gic_mpm::Material;
use gic_twin::twin::{ContactKind, MatterSource, Obstacle, ObstacleShape};

use super::*;

fn ball() -> Twin {
    let shape = serde_json::json!({
        "schema": "gic.twin/1",
        "material": {"model": "plasticine", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3, "yield_stress_pa": 1e3},
        "continuum": {"shape": "sphere", "centre_m": [0.0, 0.5, 0.0], "radius_m": 0.1},
    });
    let mut twin = Twin::of_value(Path::new("twin.json"), &shape).unwrap();
    let floor = ObstacleShape::HalfSpace { point_m: [0.0; 3], normal: [0.0, 1.0, 0.0] };
    twin.colliders.push(Obstacle::new(floor, ContactKind::Sticky));
    twin
}

#[test]
fn the_page_holds_simulator_world_and_sliders() {
    let folder = tempfile::tempdir().unwrap();
    let request = PageRequest { page: folder.path().join("live.html") };
    let outcome = view_live(&request, &ball()).unwrap();
    assert!((1000..=gic_live::MAX_PARTICLES).contains(&outcome.splats));
    let page = std::fs::read_to_string(&request.page).unwrap();
    for part in ["id=\"live-module\"", "id=\"live-numbers\"", "class LiveViewer", "Yield stress", "Poisson's ratio"] {
        assert!(page.contains(part), "the page has no {part}");
    }
    assert!(page.contains(&STANDARD.encode(MODULE)));
    // The module is one.
    assert_eq!(MODULE[..4], *b"\0asm");
}

#[test]
fn the_view_holds_the_floor() {
    let (twin, world) = ball().to_world().unwrap();
    let header = matter_header(&world, &world.bodies[0]);
    assert!(header.low_m[1] < 0.0 && header.high_m[1] > 0.6, "{:?} {:?}", header.low_m, header.high_m);
    assert!(matches!(twin.continuum, MatterSource::Solid(_)));
    assert!(matches!(twin.material, Material::Plasticine { .. }));
}

#[test]
fn sliders_hold_the_values() {
    for (key, value) in
        [("youngs_modulus_pa", 3e5), ("poisson_ratio", -0.4), ("friction_angle_deg", 70.0), ("viscosity_pa_s", 0.0)]
    {
        let slider = parameter(key, value);
        assert!(slider.range[0] <= value && value <= slider.range[1] && slider.range[0] < slider.range[1], "{key}");
    }
}

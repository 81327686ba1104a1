//! `grasp.json` and the table for people.

use serde::{Deserialize, Serialize};

/// What a grasp found, the content of `grasp.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspReport {
    /// Always `gic.grasp/1`.
    pub schema: String,
    /// Version of gic.
    pub gic_version: String,
    /// The axis asked for.
    pub axis: String,
    /// The direction in which the pads close, in the world.
    pub axis_direction: [f64; 3],
    /// Half-way between the pads before lifting [m], in the world.
    pub centre_m: [f64; 3],
    /// Width of the undeformed object between the pads [m].
    pub object_width_m: f64,
    /// Sides of a pad [m].
    pub pad_m: [f64; 2],
    /// Coulomb coefficient of the pads.
    pub friction: f64,
    /// How far the object is lifted [m].
    pub lift_m: f64,
    /// Mass of the object [kg].
    pub mass_kg: f64,
    /// Name of the law.
    pub material: String,
    /// The von Mises value of the Kirchhoff stress at which the law yields [Pa]; absent where it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yield_von_mises_pa: Option<f64>,
    /// Side of a grid cell [m].
    pub grid_spacing_m: f64,
    /// Distance of neighbouring particles [m].
    pub particle_spacing_m: f64,
    /// Number of particles.
    pub particles: usize,
    /// One entry per width, from the largest to the smallest.
    pub widths: Vec<Squeeze>,
}

/// The object held at one width.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Squeeze {
    /// Distance of the pads [m].
    pub width_m: f64,
    /// Width of the object under the pads, from its outermost particles [m].
    pub measured_width_m: f64,
    /// How far each pad is from the outermost particles [m]; what is not near zero is an artefact of the grid.
    pub standoff_m: f64,
    /// Force that presses on the pad at the lower and on that at the upper end of the axis [N].
    pub forces_n: [f64; 2],
    /// Mean of the two [N].
    pub force_n: f64,
    /// Their difference over their mean.
    pub imbalance: f64,
    /// Standard deviation of the force over the frames that it is averaged over [N].
    pub force_spread_n: f64,
    /// Area that touches the pads [m^2], in the order of the forces.
    pub contact_areas_m2: [f64; 2],
    /// Largest von Mises stress of a particle [Pa].
    pub peak_von_mises_pa: f64,
    /// 99th percentile of the particles' von Mises stress [Pa].
    pub p99_von_mises_pa: f64,
    /// Share of the matter that yields or has yielded; absent where the law has no yield stress.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yielded_share: Option<f64>,
    /// What happened when the gripper was raised; absent without gravity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lift: Option<Lift>,
}

/// The object lifted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lift {
    /// How far the matter that touched the pads slid along them [m].
    pub slip_m: f64,
    /// Whether the object was left behind.
    pub dropped: bool,
    /// Vertical force of the pads on the object at the end over its weight.
    pub carried_share: f64,
    /// Largest von Mises stress of a particle while lifting [Pa].
    pub peak_von_mises_pa: f64,
}

impl GraspReport {
    /// The report as a table for people.
    pub fn table(&self) -> String {
        let [x, y, z] = self.axis_direction;
        let mut text = format!(
            "{} object of {:.1} g, {:.2} mm wide along ({x:.3}, {y:.3}, {z:.3}); pads {:.1} x {:.1} mm, friction {}; \
             lifted by {:.0} mm\n",
            self.material,
            1e3 * self.mass_kg,
            1e3 * self.object_width_m,
            1e3 * self.pad_m[0],
            1e3 * self.pad_m[1],
            self.friction,
            1e3 * self.lift_m
        );
        text += &format!(
            "{:>9} {:>10} {:>10} {:>8} {:>12} {:>12} {:>12} {:>9} {:>9}  {}\n",
            "width mm",
            "force - N",
            "force + N",
            "+-N",
            "area mm2",
            "peak vM Pa",
            "99 % vM Pa",
            "yields",
            "slip mm",
            "lifted"
        );
        for w in &self.widths {
            let yields = match w.yielded_share {
                None => "-".into(),
                Some(share) => format!("{:.1} %", 100.0 * share),
            };
            let (slip, verdict) = match &w.lift {
                None => ("-".into(), "no gravity".to_owned()),
                Some(lift) if lift.dropped => (format!("{:.2}", 1e3 * lift.slip_m), "DROPPED".into()),
                Some(lift) => (format!("{:.2}", 1e3 * lift.slip_m), "held".into()),
            };
            let area = 0.5 * (w.contact_areas_m2[0] + w.contact_areas_m2[1]);
            text += &format!(
                "{:>9.2} {:>10.4} {:>10.4} {:>8.4} {:>12.1} {:>12.4e} {:>12.4e} {yields:>9} {slip:>9}  {verdict}\n",
                1e3 * w.width_m,
                w.forces_n[0],
                w.forces_n[1],
                w.force_spread_n,
                1e6 * area,
                w.peak_von_mises_pa,
                w.p99_von_mises_pa
            );
        }
        text.truncate(text.trim_end().len());
        text
    }
}

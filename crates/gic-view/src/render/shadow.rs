//! The soft shadow that matter throws onto a floor, by light from above.

use glam::DVec3;

/// Cells of the shadow's map along each side.
const CELLS: usize = 128;
/// How dark the middle of a shadow is.
const DARKNESS: f32 = 0.5;
/// How much wider the shadow's edge is than the matter is high above the floor.
const SOFTNESS: f64 = 0.22;

/// How much of the light from above reaches each place of a plane.
pub(super) struct FloorShadow {
    point: DVec3,
    normal: DVec3,
    axes: (DVec3, DVec3),
    low: [f64; 2],
    cell: f64,
    /// Covered share, row by row.
    covered: Vec<f32>,
}

impl FloorShadow {
    /// Of particles [m] `spacing` metres apart on the plane through `point` [m] with a `normal`; none where all lie
    /// below it.
    pub(super) fn of(positions: &[DVec3], spacing: f64, (point, normal): (DVec3, DVec3)) -> Option<Self> {
        let normal = normal.normalize_or(DVec3::Y);
        let axes = normal.any_orthonormal_pair();
        let above: Vec<DVec3> =
            positions.iter().map(|p| *p - point).filter(|p| p.is_finite() && p.dot(normal) > -spacing).collect();
        let height = above.iter().map(|p| p.dot(normal)).fold(f64::INFINITY, f64::min);
        if above.is_empty() {
            return None;
        }
        let flat = |p: &DVec3| [p.dot(axes.0), p.dot(axes.1)];
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in &above {
            for axis in 0..2 {
                low[axis] = low[axis].min(flat(p)[axis]);
                high[axis] = high[axis].max(flat(p)[axis]);
            }
        }
        let soft = spacing + SOFTNESS * height.max(0.0);
        let side = (high[0] - low[0]).max(high[1] - low[1]) + 6.0 * soft;
        let cell = (side / CELLS as f64).max(1e-9);
        low = low.map(|x| x - 3.0 * soft);
        let mut covered = vec![0.0; CELLS * CELLS];
        // A particle covers as many cells as it is wide.
        let reach = (0.6 * spacing / cell).ceil() as isize;
        for p in &above {
            let [x, y] = [0, 1].map(|axis| ((flat(p)[axis] - low[axis]) / cell) as isize);
            for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
                let (x, y) = (x + dx, y + dy);
                if (0..CELLS as isize).contains(&x) && (0..CELLS as isize).contains(&y) {
                    covered[y as usize * CELLS + x as usize] = 1.0;
                }
            }
        }
        let width = ((soft / cell) as usize).clamp(1, CELLS / 4);
        for _ in 0..3 {
            covered = blurred(&covered, width);
        }
        Some(Self { point, normal, axes, low, cell, covered })
    }

    /// Factor on the floor's brightness at a point of it [m].
    pub(super) fn light(&self, at: DVec3) -> f32 {
        let p = at - self.point;
        debug_assert!(p.dot(self.normal).abs() < 1e-6 * (1.0 + p.length()), "not on the plane");
        let place = [p.dot(self.axes.0) - self.low[0], p.dot(self.axes.1) - self.low[1]].map(|x| x / self.cell - 0.5);
        let cell = place.map(f64::floor);
        let share = [0, 1].map(|axis| (place[axis] - cell[axis]) as f32);
        let value = |dx: f64, dy: f64| {
            let (x, y) = (cell[0] + dx, cell[1] + dy);
            let inside = (0.0..CELLS as f64).contains(&x) && (0.0..CELLS as f64).contains(&y);
            if inside { self.covered[y as usize * CELLS + x as usize] } else { 0.0 }
        };
        let along = |dy: f64| value(0.0, dy) + share[0] * (value(1.0, dy) - value(0.0, dy));
        1.0 - DARKNESS * (along(0.0) + share[1] * (along(1.0) - along(0.0)))
    }
}

/// Means over squares of `2 width + 1` cells.
fn blurred(values: &[f32], width: usize) -> Vec<f32> {
    let pass = |values: &[f32], step: usize, stride: usize| {
        let mut out = vec![0.0; values.len()];
        for line in 0..CELLS {
            let at = |i: usize| values[line * stride + i * step];
            for i in 0..CELLS {
                let window = i.saturating_sub(width)..(i + width + 1).min(CELLS);
                out[line * stride + i * step] = window.map(at).sum::<f32>() / (2 * width + 1) as f32;
            }
        }
        out
    };
    pass(&pass(values, 1, CELLS), CELLS, 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_dark_below_and_light_beside() {
        let ball: Vec<DVec3> = (0..1000)
            .map(|i| DVec3::new((i % 10) as f64, 2.0 + (i / 100) as f64, (i / 10 % 10) as f64) * 0.01)
            .collect();
        let shadow = FloorShadow::of(&ball, 0.01, (DVec3::ZERO, DVec3::Y)).unwrap();
        let (below, beside) = (shadow.light(DVec3::new(0.045, 0.0, 0.045)), shadow.light(DVec3::new(0.5, 0.0, 0.0)));
        assert!(below < 0.6 && beside == 1.0, "{below} {beside}");
        let higher: Vec<DVec3> = ball.iter().map(|p| *p + DVec3::Y * 0.3).collect();
        let soft = FloorShadow::of(&higher, 0.01, (DVec3::ZERO, DVec3::Y)).unwrap();
        assert!(soft.light(DVec3::new(0.045, 0.0, 0.045)) > below, "farther away it is softer");
        assert!(FloorShadow::of(&ball, 0.01, (DVec3::Y, DVec3::Y)).is_none(), "nothing above");
    }
}

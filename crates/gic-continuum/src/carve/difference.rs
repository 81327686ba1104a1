//! How much the colours of a place differ between the cameras that see it (plane sweep: Collins 1996).
//!
//! `chi^2 = sum over views and channels of (c - mean)^2 / variance`, of as many degrees of freedom as there are
//! differences: one less than views, for each channel. Only colours of one moment are compared.

use glam::Vec3;

use super::coloured::{Coloured, Visibility};
use super::place::Place;

/// How much colours differ at each of several depths, over what is expected, and by how many that is judged.
#[derive(Clone, Copy)]
pub(crate) struct Difference<const N: usize> {
    /// Squared differences over their variances, summed, at each depth.
    pub(crate) squared: [f32; N],
    /// Degrees of freedom of these sums.
    pub(crate) freedom: f32,
}

impl<const N: usize> Difference<N> {
    pub(crate) const NONE: Difference<N> = Difference { squared: [0.0; N], freedom: 0.0 };

    pub(crate) fn add(&mut self, other: &Difference<N>) {
        self.squared.iter_mut().zip(other.squared).for_each(|(own, other)| *own += other);
        self.freedom += other.freedom;
    }

    /// So many times as much.
    pub(crate) fn scaled(mut self, factor: f32) -> Difference<N> {
        self.squared.iter_mut().for_each(|squared| *squared *= factor);
        Difference { freedom: factor * self.freedom, ..self }
    }
}

/// Sums of differences over the 3x3x3 voxels around each voxel; of those few that have places around them.
pub(super) struct SumsAround<const N: usize> {
    /// Place of each voxel in `sums`.
    slots: Vec<u32>,
    sums: Vec<Difference<N>>,
}

impl<const N: usize> SumsAround<N> {
    const NO_SLOT: u32 = u32::MAX;

    /// No sums yet around any of so many voxels.
    pub(super) fn none(voxels: usize) -> SumsAround<N> {
        SumsAround { slots: vec![Self::NO_SLOT; voxels], sums: Vec::new() }
    }

    pub(super) fn add(&mut self, voxel: usize, difference: &Difference<N>) {
        if self.slots[voxel] == Self::NO_SLOT {
            self.slots[voxel] = self.sums.len() as u32;
            self.sums.push(Difference::NONE);
        }
        self.sums[self.slots[voxel] as usize].add(difference);
    }

    pub(super) fn at(&self, voxel: usize) -> Option<&Difference<N>> {
        self.sums.get(self.slots[voxel] as usize)
    }
}

/// How much the colours of a place, moved by each of `outward` [m] along its normal, differ between the views of each
/// moment that see it.
pub(super) fn difference<const N: usize>(
    place: &Place,
    views: &[Coloured],
    depths: &[Vec<f32>],
    visibility: &Visibility,
    outward: &[f64; N],
) -> Difference<N> {
    let seen = views.iter().zip(depths).filter_map(|(view, depths)| {
        let (colours, variance) = view.colours_along_normal(place, depths, visibility, outward)?;
        Some(SeenColours { moment: view.view.moment, colours, variance })
    });
    difference_of(&seen.collect::<Vec<_>>())
}

/// What a view shows of a place at each of several depths.
#[derive(Clone, Copy)]
pub(crate) struct SeenColours<const N: usize> {
    pub(crate) moment: usize,
    pub(crate) colours: [Vec3; N],
    pub(crate) variance: Vec3,
}

/// How much colours of a place differ between views of the same moment, which follow each other.
pub(crate) fn difference_of<const N: usize>(seen: &[SeenColours<N>]) -> Difference<N> {
    let mut all = Difference::NONE;
    for same in seen.chunk_by(|a, b| a.moment == b.moment) {
        let weight: Vec3 = same.iter().map(|view| view.variance.recip()).sum();
        for k in 0..N {
            let mean = same.iter().map(|view| view.colours[k] * view.variance.recip()).sum::<Vec3>() / weight;
            let square = |view: &SeenColours<N>| (view.colours[k] - mean) * (view.colours[k] - mean) / view.variance;
            all.squared[k] += same.iter().map(square).sum::<Vec3>().element_sum();
        }
        all.freedom += 3.0 * (same.len() - 1) as f32;
    }
    all
}

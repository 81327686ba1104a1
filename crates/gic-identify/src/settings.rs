//! What the user chooses.

use glam::DVec3;

/// Which observations take part (the paper's ablation).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Extracted surfaces only ("w/o masks").
    Surfaces,
    /// Masks only (the paper's "Ours*").
    Masks,
    /// Surfaces and masks.
    Both,
}

impl Target {
    pub(crate) fn surfaces(self) -> bool {
        self != Target::Masks
    }

    pub(crate) fn masks(self) -> bool {
        self != Target::Surfaces
    }
}

/// How the loss is minimised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Optimizer {
    /// Levenberg-Marquardt on Jacobians from parallel rollouts.
    LevenbergMarquardt,
    /// The paper's Adam, with its learning rates, on the adjoint.
    Adam {
        /// Gradient steps of the material stage (the paper: 100 to 350).
        iterations: usize,
    },
}

/// Settings of identification; [`Default`] is right for every scene.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Which observations take part.
    pub target: Target,
    /// Optimiser.
    pub optimizer: Optimizer,
    /// Parameters that are known: (name, value).
    pub fixed: Vec<(String, f64)>,
    /// Starting values of the material parameters, in the order of [`crate::MaterialKind::parameters`]; `None` searches a grid.
    pub start: Option<Vec<f64>>,
    /// Initial velocity [m/s], when it is known; it is then not estimated.
    pub velocity_m_s: Option<DVec3>,
    /// Whether a rotation may be estimated; it still has to show in the data.
    pub rotation: bool,
    /// Whether the joint stage and the intervals follow the material stage. Without them the answer is rough, has no intervals, and costs about
    /// a third; the same checkpoint goes on to the whole answer.
    pub joint: bool,
    /// Most Jacobians of the last stage.
    pub iterations: usize,
    /// Frames used, from the first; `None` for all.
    pub frames: Option<usize>,
    /// Rollout on a grid refined by this factor that tells how far the estimate moves; `None` skips the check.
    pub resolution_check: Option<f64>,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            target: Target::Both,
            optimizer: Optimizer::LevenbergMarquardt,
            fixed: Vec::new(),
            start: None,
            velocity_m_s: None,
            rotation: true,
            joint: true,
            iterations: 12,
            frames: None,
            resolution_check: Some(1.25),
            seed: 0,
        }
    }
}

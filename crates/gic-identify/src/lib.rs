//! Material parameters from surfaces and masks, with error bars (paper section 4.3).

mod checkpoint;
mod error;
mod forward;
mod input;
mod observe;
mod result;
mod session;
mod settings;
mod solve;
mod stages;
mod tuning;
mod uncertainty;
mod unknowns;
mod vector;

pub use checkpoint::{Checkpoint, Event};
pub use error::{FitError, IdentifyError};
pub use input::{Input, Observation, View};
pub use result::{Estimate, Estimates, Loss, Stage, Step};
pub use settings::{MaterialChoice, Optimizer, Settings, Target};
pub use stages::identify;
pub use tuning::{
    AdamTuning, CoordinateTuning, DescentTuning, FreeFlightTuning, JointTuning, MaskTuning, MaterialTuning,
    MembershipTuning, NoiseTuning, ResolutionTuning, SearchTuning, ShapeTuning, SplatTuning, Steps, SurfaceTuning,
    Tuning, VerdictTuning,
};
pub use unknowns::parameter::{Parameter, material_of, sought, sought_values};

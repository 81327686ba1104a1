//! Material parameters from surfaces and masks, with error bars (paper section 4.3).

mod adam;
mod checkpoint;
mod checks;
mod coarse;
mod data;
mod dilution;
mod error;
mod finish;
mod flight;
mod input;
mod interval;
mod levenberg;
mod loss;
mod neighbours;
mod noise;
mod normal;
mod objective;
mod parameter;
mod result;
mod search;
mod settings;
mod shape;
mod silhouette;
mod simulation;
mod stages;
mod state;
mod surface;
mod vector;
mod velocity;

pub use checkpoint::{Checkpoint, Event};
pub use error::IdentifyError;
pub use input::{Input, Observation, View};
pub use parameter::{MaterialKind, Parameter};
pub use result::{Estimate, Identification, Loss, Stage, Step};
pub use settings::{Optimizer, Settings, Target};
pub use stages::identify;

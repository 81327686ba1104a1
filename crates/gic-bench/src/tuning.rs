//! The numbers of suites: meaning, unit, and where each comes from.

// Forecasts of suites without a finished task.

/// CPU time of a task without pictures [s]. Fitted on: bunny_elastic with three cameras, non_newtonian_2 with eleven.
pub(crate) const TASK_CPU_S: f64 = 150.0;
/// CPU time for each megapixel of a task's pictures [s]. Fitted on: bunny_elastic, non_newtonian_2.
pub(crate) const CPU_S_PER_MEGAPIXEL: f64 = 8.0;
/// Memory of a task without pictures [bytes]. Fitted on: bunny_elastic, non_newtonian_2.
pub(crate) const TASK_MEMORY_BYTES: f64 = 2.5e8;
/// Memory for each megapixel of a task's pictures [bytes]. Fitted on: bunny_elastic, non_newtonian_2.
pub(crate) const MEMORY_BYTES_PER_MEGAPIXEL: f64 = 7.0e6;
/// Share of its threads that a run keeps busy. Fitted on: non_newtonian_2.
pub(crate) const BUSY_SHARE: f64 = 0.9;

// What is asked of a cluster, which ends what takes more.

/// Time over the forecast's. Budget: forecasts know no scene, and machines differ.
pub(crate) const TIME_MARGIN: f64 = 5.0;
/// Memory over the forecast's. Budget: forecasts know no scene.
pub(crate) const MEMORY_MARGIN: f64 = 2.0;
/// Least time [minutes]. Budget: short tasks wait no longer for it.
pub(crate) const LEAST_MINUTES: f64 = 30.0;
/// Least memory [bytes]. Budget: no machine has less for a core.
pub(crate) const LEAST_MEMORY_BYTES: f64 = 1.0e9;

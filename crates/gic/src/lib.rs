//! The pipeline as a library: run folder, stages, configuration, report. The binary `gic` is a thin layer over it.

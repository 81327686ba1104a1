//! Material parameters from surfaces and masks, with error bars (paper section 4.3).

//! The stage `select`: which law the matter follows.
//!
//! Every law is fitted to the earlier frames and predicts the later ones, which it has not seen. The law that predicts
//! best wins, unless one with fewer unknowns predicts about as well: plasticine that never yields is elastic. All laws
//! are fitted roughly first, and those whose predictions are far off already stay at that.

use gic_continuum::{Appearance, Drawing, informed_gaussians};
use gic_files::FileError;
use gic_identify::{Estimates, Input, Stage as IdentifyStage};
use gic_metrics::{mean, mean_and_variance};
use gic_mpm::MaterialKind;
use gic_splat::{RenderSettings, render};
use gic_twin::atomic;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::identify::motion_of;
use super::stamp::Recipe;
use super::{Run, Stage};
use crate::error::{Error, Result};

/// Share of the frames that the laws have to predict. Paper: it predicts 10 of 30 frames.
const HELD_BACK_SHARE: f64 = 0.3;
/// A law is fitted in full if its rough fit predicts at most this many times as badly as the best one's. Budget: a full
/// fit costs three rough ones.
const FULL_FIT_ERROR_RATIO: f64 = 3.0;
/// Two laws are close if their errors differ by less than this share of the smaller one. Fitted on: five scenes, in
/// which the true law is chosen or close ...
const CLOSE_RELATIVE_DIFFERENCE: f64 = 0.1;
/// ... or by less than so many standard errors of the difference, over the cameras. Derived: 95 % of a Gaussian's.
const CLOSE_STANDARD_ERRORS: f64 = 2.0;

/// `selection.json`: how the laws predict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Selection {
    /// Frames that the laws were fitted to, from the first; they predicted the others.
    pub fitted_frames: usize,
    /// The laws, the best prediction first; those that could not be fitted last.
    pub laws: Vec<LawRecord>,
    /// The law that the run goes on with.
    pub chosen: String,
    /// Laws whose predictions the video does not tell from the chosen one's.
    pub close: Vec<String>,
}

/// One law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LawRecord {
    /// Its name.
    pub model: String,
    /// Its parameters, fitted to the earlier frames.
    pub parameters: Vec<(String, f64)>,
    /// Pixels that differ in the frames that it was fitted to, as a share of the object's; `None` where it could not be
    /// fitted.
    pub fit_error: Option<f64>,
    /// The same for each camera over the frames that it predicts; empty where the law could not be fitted.
    pub prediction_errors: Vec<f64>,
    /// Whether everything was fitted together; a law that was far off after the material stage was left there.
    pub in_full: bool,
    /// Rollouts that the fit took.
    pub rollouts: usize,
    /// Why the law could not be fitted.
    pub failure: Option<String>,
}

impl LawRecord {
    /// Mean share of pixels that differ in predicted frames; infinite where the law could not be fitted.
    pub fn prediction_error(&self) -> f64 {
        if self.prediction_errors.is_empty() { f64::INFINITY } else { mean(self.prediction_errors.iter().copied()) }
    }

    /// Whether `better`, which predicts at least as well, is not clearly better.
    fn is_close_to(&self, better: &Self) -> bool {
        let pairs = self.prediction_errors.iter().zip(&better.prediction_errors);
        let differences: Vec<f64> = pairs.map(|(a, b)| a - b).collect();
        if differences.is_empty() {
            return false;
        }
        let (average, variance) = mean_and_variance(&differences);
        let standard_error = (variance / differences.len() as f64).sqrt();
        average < (CLOSE_STANDARD_ERRORS * standard_error).max(CLOSE_RELATIVE_DIFFERENCE * better.prediction_error())
    }
}

impl Selection {
    /// Ranks the laws, which come with the fewest unknowns first.
    fn new(fitted_frames: usize, laws: Vec<LawRecord>) -> Option<Self> {
        let best = laws.iter().min_by(|a, b| a.prediction_error().total_cmp(&b.prediction_error()))?;
        if !best.prediction_error().is_finite() {
            return None;
        }
        let chosen = laws.iter().find(|law| law.is_close_to(best)).unwrap_or(best);
        let other = |law: &&LawRecord| law.model != chosen.model;
        let close = laws.iter().filter(other).filter(|law| law.is_close_to(best)).map(|law| law.model.clone());
        let (close, chosen) = (close.collect(), chosen.model.clone());
        let mut ranked = laws;
        ranked.sort_by(|a, b| a.prediction_error().total_cmp(&b.prediction_error()));
        Some(Self { fitted_frames, laws: ranked, chosen, close })
    }

    /// How surely the chosen law is the right one, in a clause.
    pub fn certainty(&self) -> String {
        match self.close.is_empty() {
            true => "no other law comes near".into(),
            false => format!("the video hardly tells it from {}", self.close.join(", ")),
        }
    }

    /// The law that the run goes on with.
    pub(super) fn chosen_model(&self) -> Result<MaterialKind> {
        MaterialKind::ALL.into_iter().find(|model| model.name() == self.chosen).ok_or_else(|| Error::Usage {
            problem: format!("selection.json chose the material {}, which is not known", self.chosen),
            hint: Some("remove selection.json from the run folder to have it made anew".into()),
        })
    }
}

impl Run<'_> {
    pub(super) fn select(&self, recipe: &Recipe) -> Result<()> {
        let folder = self.path("selection");
        let begun = self.path("stamps/select.begun.json");
        let goes_on = recipe.goes_on(&begun)?;
        if !goes_on && folder.exists() {
            std::fs::remove_dir_all(&folder).map_err(FileError::write(&folder))?;
        }
        atomic::create_folder(&folder)?;
        recipe.write(&begun)?;

        let frames = self.scene.times.len();
        // Flight shows nothing of the material: what is held back is a share of the frames behind it.
        let touched = frames - self.scene.flight.as_ref().map_or(0, |flight| flight.frames().min(frames));
        let held_back = ((HELD_BACK_SHARE * touched as f64).round() as usize).max(1);
        let fitted = frames.saturating_sub(held_back);
        let surroundings = self.surroundings()?;
        let body_of = |law: MaterialKind| -> Result<(Input, (Drawing, Appearance))> {
            let body = self.filled(law)?;
            Ok((self.identify_input(&body, &surroundings)?, self.drawing(&body)?))
        };
        // Grains lie otherwise than all else.
        let (grains, others) = (body_of(MaterialKind::Sand)?, body_of(MaterialKind::Elastic)?);
        let attempt = |model: MaterialKind, in_full: bool| {
            let (input, drawing) = if model == MaterialKind::Sand { &grains } else { &others };
            self.fit_law(model, input, drawing, (fitted, in_full))
        };
        let mut rough = Vec::new();
        for model in MaterialKind::ALL {
            rough.push(attempt(model, false)?);
        }
        let least = rough.iter().map(LawRecord::prediction_error).fold(f64::INFINITY, f64::min);
        let mut laws = Vec::new();
        for (model, rough) in MaterialKind::ALL.into_iter().zip(rough) {
            let file = folder.join(format!("{}.json", model.name()));
            let error = rough.prediction_error();
            let worth = error.is_finite() && error <= FULL_FIT_ERROR_RATIO * least;
            let law = match (worth, file.exists()) {
                (false, _) => rough,
                (true, false) => attempt(model, true)?,
                // Finished before an interruption.
                (true, true) => atomic::read_json(&file)?,
            };
            atomic::write_json(&file, &law)?;
            self.events.note(Stage::Select.name(), describe(&law));
            laws.push(law);
        }
        let selection = Selection::new(fitted, laws).ok_or_else(|| Error::Usage {
            problem: "no law could be fitted to the earlier frames".into(),
            hint: Some("see `failure` of each law in the folder `selection` of the run".into()),
        })?;
        let text = format!("goes on with {}; {}", selection.chosen, selection.certainty());
        self.events.note(Stage::Select.name(), text);
        atomic::write_json(&self.path("selection.json"), &selection)?;
        Ok(std::fs::remove_dir_all(&folder).map_err(FileError::write(&folder))?)
    }

    /// The result of selection; `None` where the law was given.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn selection_if_any(&self) -> Result<Option<Selection>> {
        if self.selects() { self.selection().map(Some) } else { Ok(None) }
    }

    pub(super) fn selection(&self) -> Result<Selection> {
        Ok(atomic::read_json(&self.path("selection.json"))?)
    }

    /// Fits a law to the first `fitted` frames, roughly or in full, and predicts the others.
    fn fit_law(
        &self,
        model: MaterialKind,
        input: &Input,
        drawing: &(Drawing, Appearance),
        (fitted, in_full): (usize, bool),
    ) -> Result<LawRecord> {
        let settings = gic_identify::Settings {
            frames: Some(self.observations_of(fitted, input)),
            stages: IdentifyStage::Search..=if in_full { IdentifyStage::Joint } else { IdentifyStage::Material },
            ..self.identify_settings(input).among_laws(model)
        };
        let checkpoint = self.path(format!("selection/{}.checkpoint.json", model.name()));
        let mut law = LawRecord {
            model: model.name().into(),
            parameters: Vec::new(),
            fit_error: None,
            prediction_errors: Vec::new(),
            in_full,
            rollouts: 0,
            failure: None,
        };
        let tried = self
            .fit(input, model, &settings, (Stage::Select, &checkpoint))
            .and_then(|found| Ok((self.prediction_errors(input, &found, drawing, fitted)?, found)));
        match tried {
            Ok((errors, found)) => {
                law.parameters = found.estimates.iter().map(|e| (e.parameter.name.to_owned(), e.value)).collect();
                law.fit_error = Some(found.loss.mask_error);
                law.prediction_errors = errors;
                law.rollouts = found.rollouts + found.coarse_rollouts;
            }
            Err(error @ Error::Interrupted { .. }) => return Err(error),
            // A law that does not suit the matter may well fail; the others need not.
            Err(error) => {
                let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}")).unwrap_or_default();
                law.failure = Some(format!("{error}{cause}"));
            }
        }
        Ok(law)
    }

    /// Pixels that differ in the frames from `fitted` on, as a share of the object's, for each camera.
    fn prediction_errors(
        &self,
        input: &Input,
        found: &Estimates,
        (drawing, drawn): &(Drawing, Appearance),
        fitted: usize,
    ) -> Result<Vec<f64>> {
        let last = input.observations.len() - 1;
        let frame_of = |frame: usize| input.frame_at(input.observations[frame].time_s);
        let moved = motion_of(input, found, frame_of(last)).map_err(Error::stage("prediction"))?;
        let appearance = Appearance { scale: found.splat_factor * drawn.scale, ..*drawn };
        let mut differing = vec![0.0; input.cameras.len()];
        let mut covered = vec![0.0; input.cameras.len()];
        for frame in self.observations_of(fitted, input)..=last {
            let positions = drawing.positions(&moved[frame_of(frame)]);
            let gaussians = informed_gaussians(&positions, &drawing.particles, &appearance);
            let views = &input.observations[frame].views;
            let sums: Vec<(f64, f64)> = views
                .par_iter()
                .map(|view| {
                    let alpha = render(&gaussians, &input.cameras[view.camera], &RenderSettings::masks()).alpha;
                    let pixels = || alpha.iter().zip(&view.mask).map(|(a, m)| (f64::from(*a), f64::from(*m)));
                    (pixels().map(|(a, m)| (a - m).abs()).sum(), pixels().map(|(_, m)| m).sum())
                })
                .collect();
            for (view, (wrong, area)) in views.iter().zip(sums) {
                differing[view.camera] += wrong;
                covered[view.camera] += area;
            }
        }
        let seen = differing.iter().zip(covered).filter(|(_, area)| *area > 0.0);
        Ok(seen.map(|(wrong, area)| wrong / area).collect())
    }
}

fn describe(law: &LawRecord) -> String {
    match &law.failure {
        Some(failure) => format!("{}: could not be fitted ({failure})", law.model),
        None => format!(
            "{}: {:.2} % of the pixels differ in fitted frames, {:.2} % in predicted ones{}",
            law.model,
            100.0 * law.fit_error.unwrap_or(f64::NAN),
            100.0 * law.prediction_error(),
            if law.in_full { "" } else { "; fitted roughly only" }
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn law(model: &str, prediction_errors: &[f64]) -> LawRecord {
        LawRecord {
            model: model.into(),
            parameters: Vec::new(),
            fit_error: Some(0.1),
            prediction_errors: prediction_errors.to_vec(),
            in_full: true,
            rollouts: 1,
            failure: prediction_errors.is_empty().then(|| "unstable".into()),
        }
    }

    #[test]
    fn the_best_prediction_wins() {
        let laws = vec![law("elastic", &[0.2, 0.21]), law("newtonian", &[]), law("plasticine", &[0.1, 0.11])];
        let selection = Selection::new(10, laws).unwrap();
        assert_eq!(selection.chosen, "plasticine");
        assert!(selection.close.is_empty());
        let order: Vec<&str> = selection.laws.iter().map(|law| law.model.as_str()).collect();
        assert_eq!(order, ["plasticine", "elastic", "newtonian"]);
    }

    #[test]
    fn of_two_that_predict_alike_the_one_with_fewer_unknowns_wins() {
        let laws = vec![law("elastic", &[0.100, 0.111]), law("plasticine", &[0.101, 0.109])];
        let selection = Selection::new(10, laws).unwrap();
        assert_eq!(
            (selection.chosen.as_str(), selection.close.as_slice()),
            ("elastic", &["plasticine".to_owned()][..])
        );
    }

    #[test]
    fn nothing_is_chosen_where_nothing_could_be_fitted() {
        assert!(Selection::new(10, vec![law("elastic", &[])]).is_none());
    }
}

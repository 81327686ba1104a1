//! The object's colours: a table of how often it shows each.

use super::tuning::{COLOUR_STEPS, NEW_COLOUR_SHARE, OBJECT_SHARE};

/// How likely the object shows a colour: densities in the cube of red, green and blue.
pub(super) struct Colours(Vec<f32>);

impl Colours {
    /// Any colour is as likely as any other.
    pub(super) fn unknown() -> Colours {
        Colours(vec![0.0; COLOUR_STEPS.pow(3)]).with_new_colours(1.0)
    }

    /// The colours of the pixels inside, each spread over its neighbours in the table.
    pub(super) fn of(image: &[[f32; 3]], inside: &[bool]) -> Colours {
        let mut counts = vec![0.0; COLOUR_STEPS.pow(3)];
        let shown = image.iter().zip(inside).filter(|(_, inside)| **inside);
        shown.for_each(|(colour, _)| counts[place(*colour)] += 1.0);
        for stride in [1, COLOUR_STEPS, COLOUR_STEPS * COLOUR_STEPS] {
            counts = spread(&counts, stride);
        }
        let total = counts.iter().sum::<f32>().max(1.0);
        let cells = counts.len() as f32;
        Colours(counts.into_iter().map(|count| count / total * cells).collect()).with_new_colours(NEW_COLOUR_SHARE)
    }

    fn with_new_colours(self, share: f32) -> Colours {
        Colours(self.0.into_iter().map(|known| (1.0 - share) * known + share * OBJECT_SHARE).collect())
    }

    /// -ln p(colour | object).
    pub(super) fn cost(&self, colour: [f32; 3]) -> f32 {
        -self.0[place(colour)].ln()
    }
}

fn place(colour: [f32; 3]) -> usize {
    let step = |value: f32| ((value * COLOUR_STEPS as f32) as usize).min(COLOUR_STEPS - 1);
    (step(colour[0]) * COLOUR_STEPS + step(colour[1])) * COLOUR_STEPS + step(colour[2])
}

/// Gives a quarter of each count to both neighbours along one channel; at the ends it stays.
fn spread(counts: &[f32], stride: usize) -> Vec<f32> {
    let neighbour = |i: usize, up: bool| match (i / stride % COLOUR_STEPS, up) {
        (0, false) => i,
        (step, true) if step == COLOUR_STEPS - 1 => i,
        (_, false) => i - stride,
        (_, true) => i + stride,
    };
    let at = |i: usize| 0.5 * counts[i] + 0.25 * (counts[neighbour(i, false)] + counts[neighbour(i, true)]);
    (0..counts.len()).map(at).collect()
}

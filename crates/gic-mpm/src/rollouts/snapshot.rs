//! Saved states.

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};

use crate::options::Precision;
use crate::substep::state::NUMBERS_PER_PARTICLE;

/// A saved state of a [`Simulator`](crate::Simulator).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Frame at whose end it was taken.
    pub frame: usize,
    /// Precision of the simulator.
    pub precision: Precision,
    /// Per particle in input order, in the frame of the grid, which lies on the ground: position [m], velocity [m/s],
    /// affine velocity gradient [1/s] and deformation gradient, matrices by rows.
    pub particles: Vec<[f64; NUMBERS_PER_PARTICLE]>,
}

/// First bytes of a saved snapshot.
const MAGIC: &[u8; 8] = b"gic-mpm1";

impl Snapshot {
    /// Writes it exactly: magic, frame, precision (0 = f32, 1 = f64), particle count, then the particles;
    /// little-endian, 8 bytes a number.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        out.write_all(MAGIC)?;
        let precision = match self.precision {
            Precision::F32 => 0u64,
            Precision::F64 => 1,
        };
        for number in [self.frame as u64, precision, self.particles.len() as u64] {
            out.write_all(&number.to_le_bytes())?;
        }
        for number in self.particles.iter().flatten() {
            out.write_all(&number.to_le_bytes())?;
        }
        Ok(())
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// Those of the reader, and `InvalidData` when it is not a snapshot.
    pub fn read(mut input: impl Read) -> io::Result<Self> {
        let mut word = || -> io::Result<[u8; 8]> {
            let mut bytes = [0; 8];
            input.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        let invalid =
            |what: &str| io::Error::new(io::ErrorKind::InvalidData, format!("not a saved simulator state: {what}"));
        if &word()? != MAGIC {
            return Err(invalid("wrong first bytes"));
        }
        let frame = u64::from_le_bytes(word()?) as usize;
        let precision = match u64::from_le_bytes(word()?) {
            0 => Precision::F32,
            1 => Precision::F64,
            _ => return Err(invalid("unknown precision")),
        };
        let count = u64::from_le_bytes(word()?) as usize;
        // Grows as it reads, so that a corrupt count cannot ask for all memory.
        let mut particles = Vec::new();
        for _ in 0..count {
            let mut particle = [0.0; NUMBERS_PER_PARTICLE];
            for number in &mut particle {
                *number = f64::from_le_bytes(word()?);
            }
            particles.push(particle);
        }
        Ok(Self { frame, precision, particles })
    }
}

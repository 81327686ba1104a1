//! Named f32 tensors and one JSON text in a safetensors file.

use std::path::Path;

use gic_files::FileError;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Serialize, de::DeserializeOwned};

use crate::{BaseMotion, MotionError};

/// Name of the tensor of bytes that holds the JSON text. Not in the format's own metadata, whose order in the file is
/// random.
const TEXT: &str = "json";

/// Writes the tensors (name, columns of a row, numbers) and the text.
pub(crate) fn write<T: Serialize>(
    path: &Path,
    tensors: &[(String, usize, &[f32])],
    text: &T,
) -> Result<(), MotionError> {
    let text = serde_json::to_vec(text).map_err(|e| MotionError::content(path, e))?;
    for (name, columns, data) in tensors {
        let columns = (*columns).max(1);
        let place = |i: usize| format!("{name}[{}][{}]", i / columns, i % columns);
        gic_files::require_finite_numbers(data, place).map_err(|e| MotionError::content(path, e))?;
    }
    let bytes: Vec<Vec<u8>> =
        tensors.iter().map(|(_, _, data)| data.iter().flat_map(|x| x.to_le_bytes()).collect()).collect();
    let mut views = Vec::new();
    for ((name, columns, data), bytes) in tensors.iter().zip(&bytes) {
        let columns = (*columns).max(1);
        let shape = vec![data.len() / columns, columns];
        let view = TensorView::new(Dtype::F32, shape, bytes).map_err(|e| MotionError::content(path, e))?;
        views.push((name.as_str(), view));
    }
    let view = TensorView::new(Dtype::U8, vec![text.len()], &text).map_err(|e| MotionError::content(path, e))?;
    views.push((TEXT, view));
    let buffer = safetensors::serialize(views, None).map_err(|e| MotionError::content(path, e))?;
    Ok(gic_files::write(path, &buffer)?)
}

/// The bytes of a file written by [`write`].
pub(crate) struct TensorFile {
    path: std::path::PathBuf,
    bytes: Vec<u8>,
}

impl TensorFile {
    pub(crate) fn open(path: &Path) -> Result<TensorFile, MotionError> {
        let bytes = gic_files::input::read(path).map_err(FileError::read(path))?;
        SafeTensors::deserialize(&bytes)
            .map_err(|e| MotionError::content(path, format!("no safetensors file: {e}")))?;
        Ok(TensorFile { path: path.to_owned(), bytes })
    }

    fn view(&self, name: &str, dtype: Dtype) -> Result<&[u8], MotionError> {
        let wrong = |e: String| MotionError::content(&self.path, format!("tensor `{name}`: {e}; write the file anew"));
        let tensors = SafeTensors::deserialize(&self.bytes).map_err(|e| wrong(e.to_string()))?;
        let tensor = tensors.tensor(name).map_err(|e| wrong(e.to_string()))?;
        if tensor.dtype() != dtype {
            return Err(wrong(format!("holds {:?}, not {dtype:?}", tensor.dtype())));
        }
        Ok(tensor.data())
    }

    /// The numbers of a tensor.
    pub(crate) fn numbers(&self, name: &str) -> Result<Vec<f32>, MotionError> {
        let bytes = self.view(name, Dtype::F32)?;
        Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    /// The numbers of a tensor of which there must be `len`.
    pub(crate) fn numbers_exactly(&self, name: &str, len: usize) -> Result<Vec<f32>, MotionError> {
        let numbers = self.numbers(name)?;
        if numbers.len() == len {
            return Ok(numbers);
        }
        let reason = format!("tensor `{name}` has {} numbers where {len} belong; write the file anew", numbers.len());
        Err(MotionError::content(&self.path, reason))
    }

    /// Rows of three.
    pub(crate) fn triples(&self, name: &str, rows: usize) -> Result<Vec<[f32; 3]>, MotionError> {
        let numbers = self.numbers_exactly(name, 3 * rows)?;
        Ok(numbers.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect())
    }

    /// Reads the fields of a base motion whose other parts are known; leaves them out where the lattice is none, which
    /// the motion's owner will complain of.
    pub(crate) fn fields(&self, prefix: &str, base: &mut BaseMotion) -> Result<(), MotionError> {
        if base.lattice.is_valid() {
            let nodes = base.lattice.nodes();
            let read = |name: &str| {
                let rows = self.triples(&format!("{prefix}{name}"), nodes * base.times.len())?;
                Ok::<_, MotionError>(rows.chunks_exact(nodes).map(<[_]>::to_vec).collect())
            };
            (base.bends, base.shades) = (read("bends")?, read("shades")?);
        }
        Ok(())
    }

    /// The JSON text.
    pub(crate) fn text<T: DeserializeOwned>(&self) -> Result<T, MotionError> {
        serde_json::from_slice(self.view(TEXT, Dtype::U8)?).map_err(|e| MotionError::content(&self.path, e))
    }
}

//! Numbers that are none do not reach a file: JSON has no form for them, and no reader expects one.
//!
//! [`require_finite`] walks what is to be written the way a serializer does and looks at its numbers.

use std::fmt::Display;

use gic_files::NotFinite;
use serde::Serialize;
use serde::ser::{self, Serializer};

/// Why a value is not written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unwritable {
    /// A number that is not finite.
    #[error(transparent)]
    NotFinite(#[from] NotFinite),
    /// A value that refuses to be serialised.
    #[error("{0}")]
    Refused(String),
}

impl ser::Error for Unwritable {
    fn custom<T: Display>(message: T) -> Self {
        Self::Refused(message.to_string())
    }
}

/// Checks that every number of a value is finite.
///
/// # Errors
/// [`Unwritable::NotFinite`] with the place of the first that is not.
pub fn require_finite(value: &(impl Serialize + ?Sized)) -> Result<(), Unwritable> {
    value.serialize(&mut Walk { place: String::new() })
}

/// A walk through a value.
struct Walk {
    /// Where it is.
    place: String,
}

impl Walk {
    /// Walks through a part of the value at `place`, which is relative to here.
    fn enter(&mut self, place: &str, part: &(impl Serialize + ?Sized)) -> Result<(), Unwritable> {
        let here = self.place.len();
        self.place.push_str(place);
        part.serialize(&mut *self)?;
        self.place.truncate(here);
        Ok(())
    }

    fn number(&self, number: impl Into<f64>) -> Result<(), Unwritable> {
        let number = number.into();
        if number.is_finite() {
            return Ok(());
        }
        Err(NotFinite { place: self.place.clone(), number: number.to_string() }.into())
    }
}

/// The parts of a list or of a map.
struct Parts<'a> {
    walk: &'a mut Walk,
    count: usize,
    key: String,
}

impl<'a> Parts<'a> {
    fn of(walk: &'a mut Walk) -> Result<Self, Unwritable> {
        Ok(Self { walk, count: 0, key: String::new() })
    }

    fn next(&mut self, part: &(impl Serialize + ?Sized)) -> Result<(), Unwritable> {
        let place = format!("[{}]", self.count);
        self.count += 1;
        self.walk.enter(&place, part)
    }

    fn under(&mut self, key: &str, part: &(impl Serialize + ?Sized)) -> Result<(), Unwritable> {
        let dot = if self.walk.place.is_empty() { "" } else { "." };
        self.walk.enter(&format!("{dot}{key}"), part)
    }
}

/// Methods for what holds no number.
macro_rules! without_numbers {
    ($($method:ident: $kind:ty),* $(,)?) => {
        $(fn $method(self, _: $kind) -> Result<(), Unwritable> { Ok(()) })*
    };
}

impl<'a> Serializer for &'a mut Walk {
    type Ok = ();
    type Error = Unwritable;
    type SerializeSeq = Parts<'a>;
    type SerializeTuple = Parts<'a>;
    type SerializeTupleStruct = Parts<'a>;
    type SerializeTupleVariant = Parts<'a>;
    type SerializeMap = Parts<'a>;
    type SerializeStruct = Parts<'a>;
    type SerializeStructVariant = Parts<'a>;

    without_numbers! {
        serialize_bool: bool, serialize_char: char, serialize_str: &str, serialize_bytes: &[u8],
        serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64, serialize_i128: i128,
        serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_u64: u64, serialize_u128: u128,
        serialize_unit_struct: &'static str,
    }

    fn serialize_f32(self, number: f32) -> Result<(), Unwritable> {
        self.number(number)
    }
    fn serialize_f64(self, number: f64) -> Result<(), Unwritable> {
        self.number(number)
    }
    fn serialize_none(self) -> Result<(), Unwritable> {
        Ok(())
    }
    fn serialize_unit(self) -> Result<(), Unwritable> {
        Ok(())
    }
    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), Unwritable> {
        value.serialize(self)
    }
    fn serialize_unit_variant(self, _: &'static str, _: u32, _: &'static str) -> Result<(), Unwritable> {
        Ok(())
    }
    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Result<(), Unwritable> {
        value.serialize(self)
    }
    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        value: &T,
    ) -> Result<(), Unwritable> {
        value.serialize(self)
    }
    fn serialize_seq(self, _: Option<usize>) -> Result<Parts<'a>, Unwritable> {
        Parts::of(self)
    }
    fn serialize_tuple(self, _: usize) -> Result<Parts<'a>, Unwritable> {
        Parts::of(self)
    }
    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Parts<'a>, Unwritable> {
        Parts::of(self)
    }
    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Parts<'a>, Unwritable> {
        Parts::of(self)
    }
    fn serialize_map(self, _: Option<usize>) -> Result<Parts<'a>, Unwritable> {
        Parts::of(self)
    }
    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Parts<'a>, Unwritable> {
        Parts::of(self)
    }
    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Parts<'a>, Unwritable> {
        Parts::of(self)
    }
}

/// Lists of all kinds.
macro_rules! walks_lists {
    ($($kind:ident, $method:ident);* $(;)?) => {
        $(impl ser::$kind for Parts<'_> {
            type Ok = ();
            type Error = Unwritable;
            fn $method<T: Serialize + ?Sized>(&mut self, part: &T) -> Result<(), Unwritable> {
                self.next(part)
            }
            fn end(self) -> Result<(), Unwritable> {
                Ok(())
            }
        })*
    };
}

walks_lists! {
    SerializeSeq, serialize_element;
    SerializeTuple, serialize_element;
    SerializeTupleStruct, serialize_field;
    SerializeTupleVariant, serialize_field;
}

/// Structures of both kinds.
macro_rules! walks_structures {
    ($($kind:ident),*) => {
        $(impl ser::$kind for Parts<'_> {
            type Ok = ();
            type Error = Unwritable;
            fn serialize_field<T: Serialize + ?Sized>(&mut self, key: &'static str, part: &T) -> Result<(), Unwritable> {
                self.under(key, part)
            }
            fn end(self) -> Result<(), Unwritable> {
                Ok(())
            }
        })*
    };
}

walks_structures!(SerializeStruct, SerializeStructVariant);

impl ser::SerializeMap for Parts<'_> {
    type Ok = ();
    type Error = Unwritable;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Unwritable> {
        let text = serde_json::to_string(key).map_err(<Unwritable as ser::Error>::custom)?;
        self.key = text.trim_matches('"').to_owned();
        Ok(())
    }
    fn serialize_value<T: Serialize + ?Sized>(&mut self, part: &T) -> Result<(), Unwritable> {
        let key = std::mem::take(&mut self.key);
        self.under(&key, part)
    }
    fn end(self) -> Result<(), Unwritable> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[derive(Serialize)]
    #[serde(tag = "kind", rename_all = "snake_case")]
    enum Part {
        Ball { radius_m: f32 },
        None,
    }

    #[derive(Serialize)]
    struct Whole {
        name: &'static str,
        intervals: BTreeMap<String, [f64; 2]>,
        parts: Vec<(Option<f64>, Part)>,
    }

    fn whole(low: f64, part: Option<f64>, radius_m: f32) -> Whole {
        let intervals = [("a".to_owned(), [0.0, 1.0]), ("b".to_owned(), [low, 1.0])].into();
        let parts = vec![(Some(1.0), Part::None), (part, Part::Ball { radius_m })];
        Whole { name: "NaN", intervals, parts }
    }

    #[test]
    fn what_is_finite_passes() {
        assert_eq!(require_finite(&whole(0.0, None, 1.0)), Ok(()));
        assert_eq!(require_finite(&whole(f64::MIN, Some(0.0), f32::MAX)), Ok(()));
    }

    #[test]
    fn what_is_not_is_named_by_its_place() {
        let place = |whole: Whole| require_finite(&whole).unwrap_err().to_string();
        assert!(place(whole(f64::NAN, None, 1.0)).starts_with("`intervals.b[0]` is NaN"));
        assert!(place(whole(0.0, Some(f64::NEG_INFINITY), 1.0)).starts_with("`parts[1][0]` is -inf"));
        assert!(place(whole(0.0, None, f32::INFINITY)).starts_with("`parts[1][1].radius_m` is inf"));
    }
}

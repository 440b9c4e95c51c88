//! How values of the JSON are read: numbers, names, ids.

use std::fmt;
use std::marker::PhantomData;

use serde::Deserialize;
use serde::de::{Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Unexpected, Visitor};

use lodpack_mesh::smooth::COMPUTED;

/// The number of an item of a list.
pub(super) type Index = Whole<u32>;
/// A count, or a number of bytes.
pub(super) type Size = Whole<u64>;

/// A whole number, which JSON may write as 2.0 or 2e0 (glTF 2.0, section 2.7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Whole<T>(pub(super) T);

impl From<Index> for usize {
    fn from(Whole(number): Index) -> usize {
        number as usize
    }
}

impl From<Size> for usize {
    /// What does not fit lies beyond every buffer, and so does the largest number.
    fn from(Whole(number): Size) -> usize {
        usize::try_from(number).unwrap_or(usize::MAX)
    }
}

impl<'de, T: TryFrom<u64>> Deserialize<'de> for Whole<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Of<T>(PhantomData<T>);
        impl<T: TryFrom<u64>> Visitor<'_> for Of<T> {
            type Value = Whole<T>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a whole number from 0 on")
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<Whole<T>, E> {
                T::try_from(number).map(Whole).map_err(|_| E::invalid_value(Unexpected::Unsigned(number), &self))
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<Whole<T>, E> {
                const MOST: f64 = (1u64 << 53) as f64;
                if (0.0..=MOST).contains(&number) && number.fract() == 0.0 {
                    return self.visit_u64(number as u64);
                }
                Err(E::invalid_value(Unexpected::Float(number), &self))
            }
        }
        deserializer.deserialize_any(Of(PhantomData))
    }
}

/// A name that is not empty, if there is one.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Name(pub(super) Option<Box<str>>);

/// What `extras` say by which other programs know a node: the text or the number of [`ID_KEYS`].
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Id(pub(super) Option<Box<str>>);

/// Keys of ids in `extras`, in any case; the first one that is there counts.
const ID_KEYS: [&str; 3] = ["id", "GlobalId", "guid"];

/// Whether a name says that the values were computed.
#[derive(Clone, Copy, Default)]
pub(super) struct Computed(pub(super) bool);

/// What a name says.
struct Names<F>(F);

impl<'de, T, F: FnOnce(&str) -> T> Visitor<'de> for Names<F> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a name")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<T, E> {
        Ok((self.0)(name))
    }

    fn visit_unit<E: Error>(self) -> Result<T, E> {
        Ok((self.0)(""))
    }
}

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Names(|name: &str| Name(not_empty(name))))
    }
}

fn not_empty(text: &str) -> Option<Box<str>> {
    (!text.is_empty()).then(|| text.into())
}

impl<'de> Deserialize<'de> for Id {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Extras;
        impl<'de> Visitor<'de> for Extras {
            type Value = Id;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("anything")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Id, A::Error> {
                let mut found: Option<(usize, Box<str>)> = None;
                while let Some(key) = map.next_key::<String>()? {
                    let Some(place) = ID_KEYS.iter().position(|known| known.eq_ignore_ascii_case(&key)) else {
                        map.next_value::<IgnoredAny>()?;
                        continue;
                    };
                    let text = map.next_value::<Text>()?.0;
                    if found.as_ref().is_none_or(|(before, _)| place < *before) {
                        found = text.map(|text| (place, text)).or(found);
                    }
                }
                Ok(Id(found.map(|(_, text)| text)))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Id, A::Error> {
                while list.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Id(None))
            }

            fn visit_bool<E: Error>(self, _: bool) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_i64<E: Error>(self, _: i64) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_u64<E: Error>(self, _: u64) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_f64<E: Error>(self, _: f64) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_str<E: Error>(self, _: &str) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_unit<E: Error>(self) -> Result<Id, E> {
                Ok(Id(None))
            }
        }
        deserializer.deserialize_any(Extras)
    }
}

/// A text that is not empty, or a number as text; nothing for all else.
struct Text(Option<Box<str>>);

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Text;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("anything")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Text, E> {
                Ok(Text(not_empty(text)))
            }

            fn visit_i64<E: Error>(self, number: i64) -> Result<Text, E> {
                Ok(Text(Some(number.to_string().into())))
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<Text, E> {
                Ok(Text(Some(number.to_string().into())))
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<Text, E> {
                Ok(Text(Some(number.to_string().into())))
            }

            fn visit_bool<E: Error>(self, _: bool) -> Result<Text, E> {
                Ok(Text(None))
            }

            fn visit_unit<E: Error>(self) -> Result<Text, E> {
                Ok(Text(None))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Text, A::Error> {
                while list.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Text(None))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Text, A::Error> {
                while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(Text(None))
            }
        }
        deserializer.deserialize_any(Any)
    }
}

impl<'de> Deserialize<'de> for Computed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Names(|name: &str| Computed(name == COMPUTED)))
    }
}

/// The weights of morph targets.
pub(super) struct Weights {
    /// Whether one of them is not 0.
    pub(super) are_set: bool,
}

impl<'de> Deserialize<'de> for Weights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Numbers;
        impl<'de> Visitor<'de> for Numbers {
            type Value = Weights;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a list of numbers")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> Result<Weights, A::Error> {
                let mut are_set = false;
                while let Some(weight) = numbers.next_element::<f64>()? {
                    are_set |= weight != 0.0;
                }
                Ok(Weights { are_set })
            }
        }
        deserializer.deserialize_seq(Numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_may_be_written_as_any_number_of_that_value() {
        let read = |text: &str| serde_json::from_str::<Index>(text).ok().map(|number| number.0);
        for (text, expected) in [("2", 2), ("2.0", 2), ("2e0", 2), ("4294967295", u32::MAX), ("-0.0", 0)] {
            assert_eq!(read(text), Some(expected), "{text}");
        }
        for text in ["2.5", "-1", "4294967296", "1e300", "\"2\"", "null"] {
            assert_eq!(read(text), None, "{text}");
        }
    }
}

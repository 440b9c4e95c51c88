//! Choices that are typed and shown by the names that they have in a list `ALL`.

/// Reads and shows the name of a choice.
macro_rules! named {
    ($($kind:ty),*) => {$(
        impl std::str::FromStr for $kind {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                let names = || Self::ALL.map(|(name, ..)| name).join(", ");
                let found = Self::ALL.into_iter().find(|(name, ..)| *name == text);
                found.map(|(_, value, _)| value).ok_or_else(|| format!("'{text}' is none of {}", names()))
            }
        }

        impl std::fmt::Display for $kind {
            fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str(Self::ALL.iter().find(|(_, value, _)| value == self).map_or("", |(name, ..)| name))
            }
        }
    )*};
}

pub(crate) use named;

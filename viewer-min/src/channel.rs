//! Which channel is shown, and what its numbers mean.

use anyhow::{Result, bail};
use lodpack::{
    File, ReadAt,
    decode::{Appearance, Look},
    index::{ChannelInfo, ChannelKind},
};

/// A channel that is shown.
#[derive(Clone, Debug)]
pub struct ShownChannel {
    /// Its number in the file.
    pub number: u8,
    pub(crate) info: ChannelInfo,
    pub(crate) appearance: Appearance,
}

impl ShownChannel {
    /// A channel of a file. Reads the coarsest images of one with a ramp: a file does not say which numbers there are.
    pub(crate) fn new<S: ReadAt>(file: &File<S>, number: u8) -> Result<Self> {
        let Some(info) = file.channels().get(usize::from(number)).cloned() else { bail!("there is no such channel") };
        let mut appearance = Appearance::new(&info);
        if appearance.look() == Look::Ramp {
            let coarsest = file.extract_textured(&file.uniform_cut(0)?, &[number])?;
            appearance.fit(coarsest.textures.iter().flat_map(|texture| texture.images.iter().flatten()));
        }
        Ok(Self { number, info, appearance })
    }

    /// A channel of a file of heights, which is made of them.
    pub(crate) fn of_heights(channels: &[ChannelInfo], number: u8) -> Result<Self> {
        let Some(info) = channels.get(usize::from(number)).cloned() else { bail!("there is no such channel") };
        Ok(Self { number, appearance: Appearance::new(&info), info })
    }

    /// The values of the ends of the ramp; none if there is no ramp.
    pub(crate) fn values(&self) -> Option<[f64; 2]> {
        self.appearance.values()
    }

    /// Gives the ends of the ramp these values.
    pub(crate) fn set_values(&mut self, values: [f64; 2]) {
        self.appearance.set_values(values);
    }
}

/// What a file of heights shows: colours, if it has a ramp, and normals from slopes.
pub(crate) fn channels_of_heights(has_ramp: bool) -> Vec<ChannelInfo> {
    let channel = |name: &str, kind| ChannelInfo {
        name: name.into(),
        kind,
        is_exact: false,
        is_scaled: false,
        components: 3,
        low: 0.0,
        step: 1.0,
        bound: 0.0,
    };
    let colour = has_ramp.then(|| channel("colour", ChannelKind::Colour));
    colour.into_iter().chain([channel("normal", ChannelKind::Normal)]).collect()
}

/// The number of the channel of normals, if there is one.
pub(crate) fn normals(channels: &[ChannelInfo]) -> Option<u8> {
    channels.iter().position(|channel| channel.kind == ChannelKind::Normal).map(|number| number as u8)
}

/// The number of the channel that says how the surface is drawn, if colours are shown and there is one.
pub(crate) fn drawing(channels: &[ChannelInfo], shown: u8) -> Option<u8> {
    let is_colour = channels.get(usize::from(shown)).is_some_and(|channel| channel.kind == ChannelKind::Colour);
    let number = channels.iter().position(|channel| channel.kind == ChannelKind::Drawing)?;
    is_colour.then_some(number as u8)
}

/// The number of the channel of this name, or the first one of colours, or that of normals; none if `name` is "none",
/// or if there is none.
pub(crate) fn find(channels: &[ChannelInfo], name: Option<&str>) -> Result<Option<u8>> {
    let number = |is_it: &dyn Fn(&ChannelInfo) -> bool| channels.iter().position(is_it).map(|number| number as u8);
    match name {
        Some("none") => Ok(None),
        None => Ok(number(&|channel| channel.kind == ChannelKind::Colour).or_else(|| normals(channels))),
        Some(name) => match number(&|channel| channel.name == name) {
            None if channels.is_empty() => bail!("the file has no channels; omit --channel"),
            None => {
                let names: Vec<&str> = channels.iter().map(|channel| channel.name.as_str()).collect();
                bail!("the file has no channel {name}; it has {}", names.join(", "))
            }
            found => Ok(found),
        },
    }
}

/// The channel after one: from none to the first, from the last to none.
pub(crate) fn after(channels: &[ChannelInfo], number: Option<u8>) -> Option<u8> {
    let next = number.map_or(0, |number| number + 1);
    let is_known = |number: &u8| {
        channels.get(usize::from(*number)).is_some_and(|channel| !matches!(channel.kind, ChannelKind::Unknown(_)))
    };
    (next..channels.len() as u8).find(is_known)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(name: &str, kind: ChannelKind) -> ChannelInfo {
        ChannelInfo {
            name: name.into(),
            kind,
            is_exact: false,
            is_scaled: false,
            components: 3,
            low: 0.0,
            step: 1.0,
            bound: 0.0,
        }
    }

    #[test]
    fn colours_come_first_and_names_are_listed() {
        let channels = [
            channel("height", ChannelKind::Scalar),
            channel("paint", ChannelKind::Colour),
            channel("?", ChannelKind::Unknown(77)),
        ];
        let found = |name| find(&channels, name);
        assert_eq!(found(None).unwrap(), Some(1));
        assert_eq!((found(Some("height")).unwrap(), found(Some("none")).unwrap()), (Some(0), None));
        assert!(found(Some("x")).unwrap_err().to_string().contains("height, paint"));
        assert!(find(&[], Some("x")).is_err());
        assert_eq!((find(&[], None).unwrap(), find(&channels[..1], None).unwrap()), (None, None));
        let all: Vec<_> = std::iter::successors(Some(None), |&now| Some(after(&channels, now))).take(4).collect();
        assert_eq!(all, [None, Some(0), Some(1), None]);
    }
}

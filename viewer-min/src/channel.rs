//! Which channel is shown, and what its numbers mean.

use anyhow::{Result, bail};
use lodpack::{
    File, ReadAt,
    decode::ChannelImage,
    index::{ChannelInfo, ChannelKind},
};

use crate::texels::Meaning;

/// The largest number of an image.
const LARGEST: f64 = 65535.0;

/// A channel that is shown.
#[derive(Clone, Debug)]
pub struct ShownChannel {
    /// Its number in the file.
    pub number: u8,
    pub(crate) info: ChannelInfo,
    /// The numbers of images that have the first and the last colour of the ramp.
    pub(crate) range: [f64; 2],
}

impl ShownChannel {
    /// A channel of a file. Reads the coarsest images of one with a ramp: a file does not say which numbers there are.
    pub(crate) fn new<S: ReadAt>(file: &File<S>, number: u8) -> Result<Self> {
        let Some(info) = file.channels().get(usize::from(number)).cloned() else { bail!("there is no such channel") };
        let mut channel = Self { number, info, range: [0.0, LARGEST] };
        if channel.values().is_some() {
            channel.range = coarsest_range(file, number)?;
        }
        Ok(channel)
    }

    /// What its texels are.
    pub(crate) fn meaning(&self) -> Meaning {
        Meaning { kind: self.info.kind, low: self.info.low, step: self.info.step }
    }

    /// The values of the ends of the ramp; none if there is no ramp.
    pub(crate) fn values(&self) -> Option<[f64; 2]> {
        let has_ramp = !matches!(
            self.info.kind,
            ChannelKind::Colour | ChannelKind::Normal | ChannelKind::Factor | ChannelKind::Label
        );
        has_ramp.then(|| self.range.map(|number| self.info.low + number * self.info.step))
    }

    /// Gives the ends of the ramp these values.
    pub(crate) fn set_values(&mut self, values: [f64; 2]) {
        self.range = values.map(|value| (value - self.info.low) / self.info.step);
    }
}

/// The smallest and the largest number of a channel at the coarsest level.
fn coarsest_range<S: ReadAt>(file: &File<S>, number: u8) -> Result<[f64; 2]> {
    let shown = file.extract_textured(&file.uniform_cut(0)?, &[number])?;
    let (mut low, mut high) = (LARGEST, 0.0_f64);
    for image in shown.textures.iter().flat_map(|texture| texture.images.iter().flatten()) {
        if let ChannelImage::Values(image) = image {
            for &value in &image.data {
                (low, high) = (low.min(value.into()), high.max(value.into()));
            }
        }
    }
    Ok(if low < high { [low, high] } else { [0.0, LARGEST] })
}

/// The number of the channel of normals, if there is one.
pub(crate) fn normals(channels: &[ChannelInfo]) -> Option<u8> {
    channels.iter().position(|channel| channel.kind == ChannelKind::Normal).map(|number| number as u8)
}

/// The number of the channel of this name, or the first one of colours, or that of normals; none if `name` is "none", or if there is none.
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
        ChannelInfo { name: name.into(), kind, components: 3, low: 0.0, step: 1.0, bound: 0.0 }
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

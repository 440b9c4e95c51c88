//! The images that materials name: whether they can be used, and copies of them for jobs.

mod causes;

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::Path;

use xxhash_rust::xxh3::Xxh3;

pub(super) use causes::Causes;

use super::ImportError;
use lodpack_mesh::appearance::{Appearance, Material};
use lodpack_mesh::images::{
    ImageSource, MAX_IMAGE_TEXELS, coded_step as coded_step_of, decoding_bytes, image_size, is_finer_than_bytes,
    texels_of, unreadable,
};
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::memory::least_for_decoding;
use lodpack_runtime::storage::{WorkDirectory, WorkError};

/// The images that some material names.
fn named_images(appearance: &Appearance) -> BTreeSet<usize> {
    appearance.materials.iter().flat_map(Material::images).map(|number| number as usize).collect()
}

/// Looks at all images that materials use. One that is finer than texels are stored is noted. One that cannot be read
/// is noted, and its materials keep their factor alone; the image that is too large is an error, and so is one whose
/// decoding takes more than its share of `memory`.
pub(super) fn check_images(
    appearance: &mut Appearance,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(), ImportError> {
    (appearance.texels, appearance.decoding_bytes) = (0, 0);
    let mut coded_step = Some(f64::INFINITY);
    appearance.image_sizes = vec![[0; 2]; appearance.images.len()];
    let (mut unusable, mut causes) = (BTreeSet::new(), Causes::default());
    for number in named_images(appearance) {
        let Some(image) = appearance.images.get(number) else { continue };
        let name = image.name();
        let look = || -> Result<_, String> {
            let open = || image.open(None).map_err(|error| unreadable(&error));
            let size = image_size(open()?)?;
            let is_allowed = texels_of(size) <= MAX_IMAGE_TEXELS;
            Ok((
                size,
                if is_allowed { decoding_bytes(open()?)? } else { 0 },
                is_finer_than_bytes(open()?)?,
                coded_step_of(open()?)?,
            ))
        };
        match look() {
            Ok(([width, height], bytes, is_finer, step)) => {
                let texels = texels_of([width, height]);
                if texels > MAX_IMAGE_TEXELS {
                    return Err(ImportError::Image { name, width, height, limit: MAX_IMAGE_TEXELS });
                }
                let least = least_for_decoding(bytes);
                if least > memory {
                    return Err(ImportError::Memory {
                        path: name.into(),
                        what: "an image of this kind",
                        remedy: "save it as a PNG without interlacing, which is decoded row by row",
                        least,
                        memory,
                    });
                }
                if is_finer {
                    causes.add("finer", &name, |name| {
                        format!("the image {name} has more than 8 bits for each number; texels of the file have 8")
                    });
                }
                coded_step = coded_step.zip(step).map(|(least, step)| least.min(step));
                appearance.texels += texels;
                appearance.image_sizes[number] = [width, height];
                appearance.decoding_bytes = appearance.decoding_bytes.max(bytes);
            }
            Err(problem) => {
                causes.add(&problem, &name, |name| {
                    format!("the image {name} cannot be used: {problem}; its material has no texture")
                });
                unusable.insert(number as u32);
            }
        }
    }
    // Without images nothing was coded.
    appearance.coded_step = coded_step.filter(|step| step.is_finite());
    causes.sentences().for_each(|sentence| progress.note(&sentence));
    appearance.materials.iter_mut().for_each(|material| drop_images(material, &unusable));
    Ok(())
}

/// Takes images away from a material.
fn drop_images(material: &mut Material, unusable: &BTreeSet<u32>) {
    for texture in [
        &mut material.base_texture,
        &mut material.opacity_texture,
        &mut material.emissive_texture,
        &mut material.metallic_roughness_texture,
        &mut material.metallic_texture,
        &mut material.roughness_texture,
    ] {
        texture.take_if(|texture| unusable.contains(&texture.image));
    }
    for texture in [&mut material.normal_texture, &mut material.occlusion_texture] {
        texture.take_if(|(texture, _)| unusable.contains(&texture.image));
    }
}

/// Copies all images that can be used to a work directory, so that the rest of the build needs nothing else.
pub(super) fn keep_images(appearance: &mut Appearance, directory: &WorkDirectory) -> Result<(), WorkError> {
    let named = named_images(appearance);
    for (number, image) in appearance.images.iter_mut().enumerate().filter(|(number, _)| named.contains(number)) {
        let Ok(encoded) = image.open(None) else { continue };
        if image_size(encoded).is_ok() {
            let kept = keep(directory, number, image)?;
            *image = kept;
        }
    }
    Ok(())
}

/// Copies an image piece by piece.
fn keep(directory: &WorkDirectory, number: usize, image: &ImageSource) -> Result<ImageSource, WorkError> {
    let (file, name) = (format!("image-{number}"), image.name());
    let path = directory.path(&file);
    let unreadable = |error| WorkError::new(Path::new(&name), "read", error);
    let mut encoded = image.open(None).map_err(unreadable)?;
    let mut copy = fs::File::create(&path).map_err(|error| WorkError::new(&path, "made", error))?;
    let (mut hash, mut bytes) = (Xxh3::new(), 0);
    loop {
        let piece = encoded.fill_buf().map_err(unreadable)?;
        if piece.is_empty() {
            break;
        }
        copy.write_all(piece).map_err(|error| WorkError::new(&path, "written", error))?;
        hash.update(piece);
        let length = piece.len();
        bytes += length as u64;
        encoded.consume(length);
    }
    directory.count(bytes);
    Ok(ImageSource::Kept { file, name, bytes, xxh3: hash.digest() })
}

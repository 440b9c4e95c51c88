//! Meshes of heights under the image that lies over them: one page, in which the place of a vertex follows from its
//! column and its row.

use std::collections::HashMap;

use lodpack::decode::texels::Image;
use lodpack::heights::{BARE, DrapeImage, Grid, HeightsMesh};

use super::layers::Layer;
use super::pages::PagedMesh;

/// A mesh whose vertices have places in one page.
///
/// `normals` are those of the mesh's vertices.
pub fn draped(mesh: &HeightsMesh, normals: &[[f32; 3]], grid: &Grid, drape: &DrapeImage) -> PagedMesh {
    let mut paged = PagedMesh { pages: vec![vec![(Layer::Colour, opaque(&drape.image))]], ..PagedMesh::default() };
    let mut numbers: HashMap<(u32, u64), u32> = HashMap::new();
    let size = drape.image.size.map(f64::from);
    let mut triangles = Vec::with_capacity(mesh.triangles.len());
    for corners in &mesh.triangles {
        let columns = columns_of(corners.map(|corner| mesh.samples[corner as usize]), grid);
        triangles.push([0, 1, 2].map(|k| {
            let (vertex, column) = (corners[k] as usize, columns[k]);
            *numbers.entry((corners[k], column.to_bits())).or_insert_with(|| {
                let place = drape.place([column, mesh.samples[vertex][1] as f64]);
                paged.positions.push(mesh.positions[vertex]);
                paged.normals.extend(normals.get(vertex));
                paged.places.push([0, 1].map(|axis| (place[axis] / size[axis]) as f32));
                paged.positions.len() as u32 - 1
            })
        }));
    }
    paged.triangles = vec![triangles];
    paged
}

/// The columns of a triangle's corners: one that is the first column and the last one is that beside the others, and a
/// pole lies between them.
fn columns_of(samples: [[u64; 2]; 3], grid: &Grid) -> [f64; 3] {
    let around = grid.cells()[0];
    let [first, last] = grid.poles();
    let is_pole = samples.map(|[_, row]| row == 0 && first || row == grid.cells()[1] && last);
    let others = || samples.iter().zip(is_pole).filter(|(_, is_pole)| !is_pole).map(|([column, _], _)| *column);
    let crosses = grid.wraps() && others().max() > others().min().map(|least| least + around / 2);
    let unrolled = |column: u64| if crosses && column == 0 { around } else { column } as f64;
    let count = others().count().max(1) as f64;
    let mean = others().map(unrolled).sum::<f64>() / count;
    [0, 1, 2].map(|k| if is_pole[k] { mean } else { unrolled(samples[k][0]) })
}

/// A piece of an image with what is transparent around it, so that it covers all of some columns and rows; as it is if
/// that would have more than `most` texels along a side.
pub fn padded(piece: DrapeImage, [columns, rows]: [[f64; 2]; 2], most: u32) -> DrapeImage {
    let size = piece.image.size;
    let reach = |axis: usize, ends: [f64; 2]| {
        let [from, to] = ends.map(|at| (at - piece.first[axis]) / piece.spacing[axis]);
        // Numbers beyond what an integer holds become its ends.
        [(-from).ceil().max(0.0) as u32, (to - f64::from(size[axis])).ceil().max(0.0) as u32]
    };
    let added = [reach(0, columns), reach(1, rows)];
    let all = [0, 1].map(|axis| size[axis].saturating_add(added[axis][0]).saturating_add(added[axis][1]));
    if all == size || all.iter().any(|&length| length > most) {
        return piece;
    }
    let mut image = Image::filled(all, &[0; 4]);
    let (width, count) = (size[0] as usize, usize::from(piece.image.components));
    for (row, from) in piece.image.data.chunks_exact(width * count).enumerate() {
        let first = (row + added[1][0] as usize) * all[0] as usize + added[0][0] as usize;
        let to = image.data[4 * first..][..4 * width].as_chunks_mut::<4>().0;
        for (to, from) in to.iter_mut().zip(from.chunks_exact(count)) {
            to.iter_mut().zip(from.iter().chain([&255])).for_each(|(to, from)| *to = *from);
        }
    }
    let first = [0, 1].map(|axis| piece.first[axis] - f64::from(added[axis][0]) * piece.spacing[axis]);
    DrapeImage { image, first, spacing: piece.spacing }
}

/// The colours of an image over what is seen where it is transparent.
pub fn opaque(image: &Image<u8>) -> Image<u8> {
    if image.components == 3 {
        return image.clone();
    }
    let texel = |texel: &[u8]| over(texel, BARE);
    Image { size: image.size, components: 3, data: image.data.chunks_exact(4).flat_map(texel).collect() }
}

/// A colour, with opacity if it has four components, over another one, as screens show them.
pub fn over(texel: &[u8], below: [u8; 3]) -> [u8; 3] {
    let opacity = texel.get(3).map_or(255, |&opacity| u32::from(opacity));
    let mixed = |k: usize| {
        let own = texel.get(k).map_or(0, |&x| u32::from(x));
        ((own * opacity + u32::from(below[k]) * (255 - opacity) + 127) / 255) as u8
    };
    [mixed(0), mixed(1), mixed(2)]
}

/// The colour of a vertex: what the image shows there, over what is seen without it.
pub fn colour_at(drape: &DrapeImage, sample: [u64; 2], below: [u8; 3]) -> [u8; 3] {
    let values = drape.image.interpolated(drape.place(sample.map(|x| x as f64)));
    let texel = values.map(|x| (x + 0.5) as u8);
    over(&texel[..drape.image.components.into()], below)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_across_the_end_of_a_globe_lie_beside_it_and_poles_between_their_corners() {
        let globe = Grid::new([360, 180], true, [true, true]).unwrap();
        assert_eq!(columns_of([[359, 5], [0, 5], [0, 6]], &globe), [359.0, 360.0, 360.0]);
        assert_eq!(columns_of([[0, 5], [1, 5], [0, 6]], &globe), [0.0, 1.0, 0.0]);
        assert_eq!(columns_of([[0, 0], [20, 1], [24, 1]], &globe), [22.0, 20.0, 24.0]);
        let plane = Grid::new([360, 180], false, [false; 2]).unwrap();
        assert_eq!(columns_of([[359, 5], [0, 5], [0, 0]], &plane), [359.0, 0.0, 0.0]);
    }

    #[test]
    fn a_padded_piece_has_its_texels_where_they_were() {
        let image = Image { size: [2, 1], components: 3, data: vec![1, 2, 3, 4, 5, 6] };
        let piece = DrapeImage { image, first: [10.0, 4.0], spacing: [0.5, 1.0] };
        let all = padded(piece.clone(), [[9.0, 12.0], [4.0, 5.0]], 100);
        assert_eq!((all.image.size, all.first), ([6, 1], [9.0, 4.0]));
        assert_eq!(all.image.texel(2, 0), [1, 2, 3, 255]);
        assert_eq!(all.image.texel(4, 0), [0; 4]);
        assert_eq!(padded(piece.clone(), [[9.0, 12.0], [4.0, 5.0]], 5), piece);
    }

    #[test]
    fn what_is_transparent_shows_what_is_below() {
        assert_eq!(over(&[10, 20, 30], [1; 3]), [10, 20, 30]);
        assert_eq!(over(&[10, 20, 30, 0], [1, 2, 3]), [1, 2, 3]);
        assert_eq!(over(&[200, 100, 0, 128], [0, 0, 100]), [100, 50, 50]);
    }
}

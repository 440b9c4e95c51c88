//! What triangles carry beside their shape, from an input to the regions of a job.

use super::regions::messy;
use crate::region::{DividedMesh, Division, Region, RegionStore, Regions};
use lodpack_import::{Imported, Overflow, Room};
use lodpack_mesh::Mesh;
use lodpack_mesh::appearance::{Appearance, Material, ScalarRange};
use lodpack_mesh::attributes::{
    AttributeLayout, Attributes, ChartRun, FileAttributes, MaterialRun, ObjectNode, ObjectRun, Surface,
};
use lodpack_runtime::progress::Silent;
use lodpack_runtime::storage::JobId;
use lodpack_stage::arcs::Seams;

/// A surface whose vertices carry their position, and whose corners carry the number of their triangle. Its second half
/// has another material, and is another chart; its first quarter is an object of its own.
fn telling(mesh: Mesh) -> Surface {
    let mut layout = AttributeLayout::default();
    ["x", "y", "z", "triangle"].iter().for_each(|name| layout.add_scalar(name));
    let numbers = (0..mesh.triangles.len()).flat_map(|number| [number as f32; 3]);
    let half = mesh.triangles.len() as u32 / 2;
    let attributes = Attributes {
        files: vec![FileAttributes {
            vertex_stride: 3,
            corner_stride: 1,
            layout: layout.clone(),
            ..FileAttributes::default()
        }],
        materials: vec![MaterialRun { first_triangle: half, material: 1 }],
        charts: [(0, 7), (half, 2)].map(|(first_triangle, chart)| ChartRun { first_triangle, chart }).to_vec(),
        nodes: vec![ObjectNode::default(); 2],
        objects: [(0, 1), (half / 2, 0)].map(|(first_triangle, node)| ObjectRun { first_triangle, node }).to_vec(),
        vertex_values: mesh.positions.iter().flat_map(|position| position.as_vec3().to_array()).collect(),
        corner_values: numbers.collect(),
    };
    let scalars = layout.scalars.iter().map(|(name, _)| ScalarRange::new(name)).collect();
    let materials = vec![Material::default(), Material { base_colour: [0.5; 4], ..Material::default() }];
    let appearance = Appearance { layout, has_colour: true, scalars, materials, ..Appearance::default() };
    Surface { mesh, attributes, appearance }
}

/// Checks what every corner of a region says of itself; returns the numbers of its triangles.
fn assert_tells_the_truth(region: &Region, half: usize) -> Vec<usize> {
    assert!(region.attributes.fits(region.mesh.triangles.len()));
    let triangle = |t: usize| {
        let records = region.attributes.records_of(t, 4);
        for (record, position) in records.iter().zip(region.mesh.corners(t as u32)) {
            assert_eq!(record[..3], position.as_vec3().to_array());
        }
        let number = records[0][3] as usize;
        assert!(records.iter().all(|record| record[3] as usize == number));
        assert_eq!(region.attributes.material(t), u16::from(number >= half));
        assert_eq!(region.attributes.charts[t], if number >= half { 2 } else { 7 });
        assert_eq!(region.attributes.objects[t], u32::from(number < half / 2));
        number
    };
    (0..region.mesh.triangles.len()).map(triangle).collect()
}

#[test]
fn corners_keep_their_records_through_division_repair_and_files() {
    let surface = telling(messy());
    let half = surface.mesh.triangles.len() / 2;
    for triangles in [300, 1000, u64::MAX] {
        let division = Division { triangles, is_fixed: false };
        let Regions { store, appearance, repairs, .. } = Regions::in_memory(surface.clone(), division);
        assert!(appearance == surface.appearance && repairs.flipped_faces > 0);
        let RegionStore::Memory(in_memory) = store else { panic!("no disk is used") };
        let mut numbers: Vec<usize> =
            in_memory.iter().flat_map(|region| assert_tells_the_truth(region, half)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), in_memory.iter().map(|region| region.mesh.triangles.len()).sum::<usize>());

        let parent = tempfile::tempdir().expect("a temporary directory");
        let room = Room { memory: 1000, overflow: Overflow::New(parent.path().join("work")) };
        let Ok(Imported::Spilled(mesh)) = Imported::new(surface.clone(), &room) else { panic!("it does not fit") };
        let directory = mesh.directory.clone();
        DividedMesh::new(mesh, division, JobId(1)).expect("there is space");
        // As a process that resumes the job opens it.
        let divided = DividedMesh::open(&directory, JobId(1)).expect("what was written");
        let mut regions = Regions::on_disk(divided, 1 << 30, true, None, &Silent).expect("a sound mesh");
        let stats = std::mem::take(&mut regions.stats);
        let labels = |region: &Region, _: &_| (vec![0; region.mesh.triangles.len()], ());
        regions.store.set_labels(&stats, &Silent, labels).expect("there is space");
        let RegionStore::Directory(store) = &regions.store else { panic!("regions are on disk") };
        for (number, expected) in in_memory.into_iter().enumerate() {
            store.put_seams(number, &Seams::default()).expect("there is space");
            let (region, _) = store.load_charted(number).expect("what was written");
            let labels = vec![0; region.mesh.triangles.len()];
            assert!(region == Region { labels, ..expected }, "region {number}");
            assert_eq!(stats[number].attribute_bytes, region.attributes.bytes());
        }
        let left: Vec<_> = std::fs::read_dir(directory.folder()).expect("readable").flatten().collect();
        assert!(left.iter().all(|file| !file.file_name().to_string_lossy().contains("values")), "{left:?}");
    }
}

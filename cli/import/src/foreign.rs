//! Formats of models that are not read, and what to do with them: people try them, so they are named.

/// A format with its article, and a remedy.
type Named = (&'static str, &'static str);

const SOLID: &str =
    "its surfaces are exact and have no triangles yet: open it in FreeCAD or Gmsh, and export STL, OBJ or glTF";
const SCENE: &str = "open it in Blender, and export glTF (.glb)";
const PRINT: &str = "open it in a slicer or in Blender, and export STL or OBJ";
const POINTS: &str = "it holds points, which have no surface: make a mesh of them (CloudCompare, MeshLab) and build that as PLY, \
                      or heights (pdal, with writers.gdal) and build the GeoTIFF";
const VTK: &str = "open it in ParaView, extract the surface, and save it as PLY or STL";
const ARCHIVE: &str = "unpack it, and build the mesh in it";

const STEP: Named = ("a STEP file", SOLID);
const FBX: Named = ("an FBX file", SCENE);
const USD: Named = ("a USD file", SCENE);
const COLLADA: Named = ("a COLLADA file (DAE)", SCENE);
const LAS: Named = ("a LAS or LAZ file", POINTS);
const E57: Named = ("an E57 file", POINTS);

/// Bytes in which a word of XML is looked for.
const HEAD: usize = 4096;

/// A format that the first bytes tell for sure, of archives together with the name.
pub(super) fn by_content(bytes: &[u8], extension: &str) -> Option<Named> {
    let begins: [(&[u8], Named); 12] = [
        (b"ISO-10303-21", STEP),
        (b"Kaydara FBX Binary", FBX),
        (b"; FBX ", FBX),
        (b"#usda ", USD),
        (b"PXR-USDC", USD),
        (b"LASF", LAS),
        (b"ASTM-E57", E57),
        (b"# .PCD ", ("a PCD file", POINTS)),
        (b"BLENDER", ("a Blender file", SCENE)),
        (b"# vtk DataFile", ("a VTK file", VTK)),
        (b"7z\xBC\xAF\x27\x1C", ("a 7-Zip archive", ARCHIVE)),
        (b"Rar!\x1A\x07", ("a RAR archive", ARCHIVE)),
    ];
    if let Some((_, named)) = begins.into_iter().find(|(begin, _)| bytes.starts_with(begin)) {
        return Some(named);
    }
    let head = &bytes[..bytes.len().min(HEAD)];
    let has = |word: &[u8]| head.windows(word.len()).any(|found| found == word);
    if bytes.starts_with(b"PK\x03\x04") {
        // Packages name their parts at their beginning.
        return Some(match () {
            () if has(b"3D/3dmodel.model") => ("a 3MF file", PRINT),
            () if has(b".usdc") || has(b".usda") => USD,
            () => by_name(extension).unwrap_or(("a ZIP archive", ARCHIVE)),
        });
    }
    let is_xml = head.trim_ascii_start().starts_with(b"<") || bytes.starts_with(b"\xEF\xBB\xBF<");
    match is_xml {
        true if has(b"<COLLADA") => Some(COLLADA),
        true if has(b"<VTKFile") => Some(("a VTK file", VTK)),
        true if has(b"<X3D") => Some(("an X3D file", SCENE)),
        _ => None,
    }
}

/// A format that only the name tells, in lower case.
pub(super) fn by_name(extension: &str) -> Option<Named> {
    Some(match extension {
        "step" | "stp" => STEP,
        "iges" | "igs" => ("an IGES file", SOLID),
        "fbx" => FBX,
        "usd" | "usda" | "usdc" | "usdz" => USD,
        "dae" => COLLADA,
        "3ds" => ("a 3DS file", SCENE),
        "blend" => ("a Blender file", SCENE),
        "wrl" | "x3d" => ("a VRML or X3D file", SCENE),
        "3mf" => ("a 3MF file", PRINT),
        "amf" => ("an AMF file", PRINT),
        "las" | "laz" => LAS,
        "e57" => E57,
        "pcd" | "pts" | "ptx" | "xyz" => ("a file of points", POINTS),
        "vtk" | "vtp" | "vtu" => ("a VTK file", VTK),
        "zip" | "7z" | "rar" | "gz" => ("an archive", ARCHIVE),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_that_are_not_read_are_named() {
        let content = |bytes: &[u8]| by_content(bytes, "3mf").map(|(name, _)| name);
        assert_eq!(content(b"ISO-10303-21;\nHEADER;"), Some("a STEP file"));
        assert_eq!(content(b"<?xml version=\"1.0\"?>\n<COLLADA>"), Some("a COLLADA file (DAE)"));
        assert_eq!(content(b"PK\x03\x04........3D/3dmodel.model"), Some("a 3MF file"));
        assert_eq!(content(b"PK\x03\x04........scene.usdc"), Some("a USD file"));
        assert_eq!(content(b"PK\x03\x04........[Content_Types].xml"), Some("a 3MF file"));
        assert_eq!(content(b"LASF\0\0"), Some("a LAS or LAZ file"));
        assert_eq!(content(b"ply\nformat ascii 1.0\n"), None);
        assert_eq!(content(b"# a mesh\nv 0 0 0\n"), None);
        assert_eq!(content(b""), None);
        for extension in ["stp", "fbx", "usdz", "dae", "3mf", "laz", "e57"] {
            assert!(by_name(extension).is_some_and(|(_, remedy)| !remedy.is_empty()));
        }
        assert_eq!(by_name("obj").or(by_name("")), None);
    }
}

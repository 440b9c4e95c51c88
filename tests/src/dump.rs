//! The decoded content of a file as JSON: the same text that `format-spec/decode.py` prints.
//! `format-spec/vectors/README.md` describes the layout.

use lodpack::{
    File, FileObjects, Ground, LatticePoint, Overview, ReadAt, Result,
    decode::Patch,
    heights::SIDE,
    index::{BlockContents, ChannelInfo, Placement, RootContents, Scale, TexelBytes},
    objects::ObjectNode,
};
use std::fmt::{Display, Write};

/// Renders everything that the file decodes to: the arcs with all their samples, then every root at each of its levels.
///
/// # Errors
///
/// [`lodpack::Error`] if the file is unsound.
pub fn dump<R: ReadAt>(file: &File<R>) -> Result<String> {
    let lattice = file.lattice();
    let levels = (0..file.level_count()).filter_map(|level| file.level(level)).map(|level| {
        format!(
            r#"{{"tolerance":{},"max_error":{},"triangle_count":{}}}"#,
            bits(level.tolerance),
            bits(level.max_error),
            level.triangle_count
        )
    });
    let borders = file.borders()?;
    let corners = borders.corners.iter().zip(&borders.corner_levels);
    let corners = corners.map(|(position, level)| format!("[{level},{}]", point(position)));
    let arcs = borders.arcs.iter().map(|arc| {
        let samples = arc.samples.iter().map(|s| format!("[{},{},{}]", s.param, s.level, point(&s.position)));
        format!(r#"{{"corners":{},"samples":{}}}"#, list(arc.ends), list(samples))
    });
    let roots = (0..file.root_count()).map(|root| root_text(file, root)).collect::<Result<Vec<_>>>()?;

    let mut members = vec![
        format!(r#""lattice":{{"origin":{},"step_log2":{}}}"#, list(lattice.origin.map(bits)), lattice.step_log2),
        lines("levels", levels),
        lines("corners", corners),
        lines("arcs", arcs),
        lines("roots", roots),
    ];
    if let Some(overview) = file.overview()? {
        members.push(format!(r#""overview":{}"#, overview_text(&overview)));
    }
    if !file.channels().is_empty() {
        members.push(format!(r#""texel_bytes":{}"#, list(file.index().texel_bytes())));
        members.push(lines("channels", file.channels().iter().map(channel_text)));
    }
    if let Some(Placement { up, unit, origin, crs }) = file.placement() {
        let (up, unit, origin) = (*up as u8, bits(unit.unwrap_or(0.0)), list(origin.map(bits)));
        let crs = ascii(crs);
        members.push(format!(r#""placement":{{"up":{up},"unit":{unit},"origin":{origin},"crs":"{crs}"}}"#));
    }
    if let Some(objects) = file.objects() {
        members.extend(objects_text(file, &objects)?);
    }
    if let Some(ground) = file.ground()? {
        members.push(format!(r#""ground":{}"#, ground_text(&ground)?));
    }
    Ok(format!("{{\n{}\n}}\n", members.join(",\n")))
}

/// The size of a ground, and where the middles of its first tiles are under the surface.
fn ground_text<R: ReadAt>(Ground { heights, frame }: &Ground<R>) -> Result<String> {
    let [columns, rows] = heights.grid().cells();
    let mut middles = vec![];
    for &root in heights.roots() {
        if let Some(tile) = heights.tile(root)? {
            let middle = heights.draw(root, &tile, f64::INFINITY).position(SIDE * SIDE / 2);
            middles.push(list(frame.point(middle).map(bits)));
        }
    }
    let (scale, middles) = (bits(frame.scale()), list(middles));
    Ok(format!(r#"{{"columns":{columns},"rows":{rows},"scale":{scale},"middles":{middles}}}"#))
}

/// All nodes, and of each leaf its objects and those of the islands of each block.
fn objects_text<R: ReadAt>(file: &File<R>, objects: &FileObjects<'_, R>) -> Result<[String; 3]> {
    let mut nodes = vec![];
    for number in 0..objects.node_count() {
        let ObjectNode { name, id, parent } = objects.node(number)?;
        let text = |text: &Option<String>| text.as_ref().map_or("null".into(), |text| format!("\"{}\"", ascii(text)));
        let parent = parent.map_or("null".into(), |parent| parent.to_string());
        nodes.push(format!("[{},{},{parent}]", text(&name), text(&id)));
    }
    let mut leaves = vec![];
    for root in 0..file.root_count() {
        if file.children(root)?.is_empty() {
            let blocks = file.root_contents(root)?.blocks;
            let owners = blocks.iter().map(|block| objects.owners(root, block.level).map(list));
            let owners = list(owners.collect::<Result<Vec<_>>>()?);
            leaves.push(format!("[{root},{},{owners}]", list(objects.of_leaf(root)?)));
        }
    }
    Ok([format!(r#""object_count":{}"#, objects.count()), lines("nodes", nodes), lines("owners", leaves)])
}

/// A text in ASCII, as Python writes it.
fn ascii(text: &str) -> String {
    let one = |c: char| if c.is_ascii_graphic() && c != '"' && c != '\\' { c.to_string() } else { escaped(c) };
    text.chars().map(one).collect()
}

/// A character of a text as UTF-16 in ASCII.
fn escaped(c: char) -> String {
    c.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")).collect()
}

fn root_text<R: ReadAt>(file: &File<R>, root: u32) -> Result<String> {
    let RootContents { filling, loops, bounds: [low, high], blocks } = file.root_contents(root)?;
    let filling = filling.name();
    let loops = loops.iter().map(|half_arcs| list(half_arcs.iter().map(|h| list([h.arc, u32::from(h.reversed)]))));
    let mut texts = vec![];
    let channels: Vec<u8> = (0..file.channels().len() as u8).collect();
    for block in &blocks {
        let texels = file.texels(&[(root, block.level)], &channels, Scale::Full)?;
        let texels = texels.iter().filter(|_| !channels.is_empty()).map(texel_text).collect::<String>();
        texts.push(block_text(block, &file.decode_root(root, block.level)?.patch, &texels));
    }
    let parent = file.parent(root)?.map_or("null".to_owned(), |parent| parent.to_string());
    Ok(format!(
        r#"{{"parent":{parent},"children":{},"filling":"{filling}","loops":{},"low":{},"high":{},{}}}"#,
        list(file.children(root)?),
        list(loops),
        point(&low),
        point(&high),
        lines("blocks", texts)
    ))
}

fn block_text(block: &BlockContents, patch: &Patch, texels: &str) -> String {
    format!(
        r#"{{"level":{},"error":{},"border_deviation":{},"triangle_count":{},"interior":{},"triangles":{}{texels}}}"#,
        block.level,
        bits(block.error),
        bits(block.border_deviation),
        block.triangle_count,
        list(patch.interior.iter().map(point)),
        list(patch.triangles.iter().map(list))
    )
}

/// The texel streams of a block, as hexadecimal digits.
fn texel_text(texels: &TexelBytes) -> String {
    let hex = |bytes: &Vec<u8>| format!("\"{}\"", bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>());
    format!(r#","texels":{}"#, list([&texels.map].into_iter().chain(texels.images.iter().flatten()).map(hex)))
}

fn channel_text(channel: &ChannelInfo) -> String {
    let ChannelInfo { name, kind, is_exact, is_scaled, components, low, step, bound } = channel;
    let coding = if *is_exact {
        "exact "
    } else if *is_scaled {
        "scaled "
    } else {
        ""
    };
    let kind = kind.name();
    let [low, step, bound] = [low, step, bound].map(|&x| bits(x));
    let name = quoted(name);
    format!(
        r#"{{"name":{name},"kind":"{coding}{kind}","components":{components},"low":{low},"step":{step},"bound":{bound}}}"#
    )
}

/// A text as JSON in ASCII.
fn quoted(text: &str) -> String {
    let unit = |unit: u16| match u8::try_from(unit).map(char::from) {
        Ok(c @ ('"' | '\\')) => format!("\\{c}"),
        Ok(c @ ' '..='~') => c.to_string(),
        _ => format!("\\u{unit:04x}"),
    };
    format!("\"{}\"", text.encode_utf16().map(unit).collect::<String>())
}

fn overview_text(overview: &Overview) -> String {
    format!(
        r#"{{"error":{},"loops":{},"interior":{},"triangles":{}}}"#,
        bits(overview.error),
        list(overview.loops.iter().map(|points| list(points.iter().map(point)))),
        list(overview.patch.interior.iter().map(point)),
        list(overview.patch.triangles.iter().map(list))
    )
}

/// A number as the 16 hexadecimal digits of its binary64 form, in quotes: no two printers disagree about those.
fn bits(x: f64) -> String {
    format!("\"{:016x}\"", x.to_bits())
}

fn point(point: &LatticePoint) -> String {
    list(point)
}

fn list<T: Display>(items: impl IntoIterator<Item = T>) -> String {
    let items: Vec<String> = items.into_iter().map(|item| item.to_string()).collect();
    format!("[{}]", items.join(","))
}

/// A member with one item per line.
fn lines(name: &str, items: impl IntoIterator<Item = String>) -> String {
    let mut text = format!("\"{name}\":[");
    for (k, item) in items.into_iter().enumerate() {
        let _ = write!(text, "{}\n{item}", if k > 0 { "," } else { "" });
    }
    text + "\n]"
}

//! What colours cost: bytes, error and decoding time of an image at several qualities, as blocks store it.
//!
//!     cargo run --release -p lodpack --features write --example texel_rates -- IMAGE.ppm [STEP ...]
//!
//! IMAGE is a binary PPM (P6) of 8 bits. Prints for each step of quantisation (0 for none, as exact channels have it)
//! the bits per texel, the PSNR over the three components, and the texels decoded per second of processor time by one
//! thread. `tests/bench/texel_rates.py` puts other codecs beside these.

#![expect(clippy::disallowed_methods, reason = "nothing is built from a logarithm here")]

use std::time::Instant;

use lodpack::decode::texels::Image;
use lodpack::write::{encode_exact_image, encode_image};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((path, steps)) = arguments.split_first() else {
        eprintln!("usage: texel_rates IMAGE.ppm [STEP ...]");
        std::process::exit(2);
    };
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("cannot read {path}: {error}"));
    let image = parse(&bytes).unwrap_or_else(|| panic!("{path} is no binary PPM of 8 bits"));
    let steps: Vec<u8> = match steps {
        [] => vec![0, 2, 4, 6, 9, 13, 20, 30, 45],
        given => given.iter().map(|step| step.parse().expect("a step is a number from 0 to 255")).collect(),
    };
    let texels = f64::from(image.size[0]) * f64::from(image.size[1]);
    let used = vec![true; texels as usize];
    println!("step  bits/texel   PSNR dB   Mtexel/s");
    for step in steps {
        let coded =
            if step == 0 { vec![encode_exact_image(&image, &used)] } else { encode_image(&image, &used, step).into() };
        let decode = |coded: &[Vec<u8>], size, components| match step {
            0 => Image::decode_exact(&coded[0], size, components),
            _ => Image::decode_scaled(coded, size, components),
        };
        let start = Instant::now();
        let decoded = decode(&coded, image.size, 3).expect("it was just encoded");
        let seconds = start.elapsed().as_secs_f64();
        let difference = |(&a, &b): (&u8, &u8)| f64::from(a.abs_diff(b)) * f64::from(a.abs_diff(b));
        let squares: f64 = image.data.iter().zip(&decoded.data).map(difference).sum();
        let decibels = 10.0 * (255.0 * 255.0 * 3.0 * texels / squares).log10();
        let bits = coded.concat().len() as f64 * 8.0 / texels;
        println!("{step:4}  {bits:10.3}  {decibels:8.2}  {:9.1}", texels / seconds / 1e6);
    }
}

/// Reads a PPM: three numbers after "P6", then the texels.
fn parse(bytes: &[u8]) -> Option<Image<u8>> {
    let mut rest = bytes.strip_prefix(b"P6")?;
    let mut numbers = vec![];
    while numbers.len() < 3 {
        rest = rest.trim_ascii_start();
        if rest.first() == Some(&b'#') {
            let end = rest.iter().position(|&byte| byte == b'\n')?;
            rest = &rest[end..];
            continue;
        }
        let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
        numbers.push(std::str::from_utf8(&rest[..digits]).ok()?.parse::<u32>().ok()?);
        rest = &rest[digits..];
    }
    let (size, data) = ([numbers[0], numbers[1]], rest.get(1..)?.to_vec());
    let whole = data.len() as u64 == 3 * u64::from(size[0]) * u64::from(size[1]);
    (numbers[2] == 255 && whole).then_some(Image { size, components: 3, data })
}

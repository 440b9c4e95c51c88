use lodpack::{File, Limits};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let bytes = std::fs::read(&a[1]).unwrap();
    let file = File::open(bytes.as_slice(), Limits::default()).unwrap();
    let cut = file.uniform_cut(file.level_count() as u8 - 1).unwrap();
    for _ in 0..a[2].parse::<usize>().unwrap() { std::hint::black_box(file.extract(&cut).unwrap()); }
}

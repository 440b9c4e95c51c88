use super::*;
use glam::DVec3;

#[test]
fn records_come_back_and_go_with_the_directory() {
    let parent = tempfile::tempdir().unwrap();
    let directory = WorkDirectory::create(&parent.path().join("work")).unwrap();
    let points: Vec<DVec3> = (0..100_000).map(|i| DVec3::new(f64::from(i), -0.0, 1.0 / f64::from(i))).collect();
    let mut writer = RecordWriter::create(&directory, "vertices").unwrap();
    writer.push_all(&points).unwrap();
    let path = writer.finish().unwrap();
    let read = RecordReader::<DVec3>::open(&path).unwrap().read_all().unwrap();
    assert!(read.iter().zip(&points).all(|(a, b)| a.to_array().map(f64::to_bits) == b.to_array().map(f64::to_bits)));
    assert_eq!((read.len(), directory.most_bytes()), (points.len(), 2_400_000));

    let lookup = Lookup::open(&path).unwrap();
    assert!((0..100_000).rev().step_by(7).all(|i| lookup.position(i).x == f64::from(i)));
    assert_eq!(lookup.count(), 100_000);
    // More is added behind what is there, and counts.
    let mut writer = RecordWriter::append(&directory, "vertices").unwrap();
    writer.push_all(&points[..1]).unwrap();
    writer.finish().unwrap();
    assert_eq!(RecordReader::<DVec3>::open(&path).unwrap().read_all().unwrap().len(), 100_001);
    directory.remove(&path);
    directory.remove(&path);
    drop((lookup, directory));
    assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
}

#[test]
fn errors_name_the_file() {
    let parent = tempfile::tempdir().unwrap();
    let error = WorkDirectory::create(&parent.path().join("nowhere/work")).unwrap_err();
    assert!(error.to_string().contains("nowhere"), "{error}");
    assert!(RecordReader::<u32>::open(&parent.path().join("nothing")).is_err());
}

#[test]
fn a_directory_belongs_to_one_at_a_time_and_stays_if_it_is_kept() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let first = WorkDirectory::create(&path).unwrap();
    assert!(WorkDirectory::create(&path).is_err(), "there is something in it");
    let error = WorkDirectory::open(&path).unwrap_err();
    assert_eq!(error.source.kind(), io::ErrorKind::WouldBlock);
    assert!(error.source.to_string().contains(&std::process::id().to_string()), "{}", error.source);
    first.keep(true);
    drop(first);
    assert_eq!(Lock::holder(&path.join(LOCK_NAME)), None);
    let second = WorkDirectory::open(&path).unwrap();
    assert!(Lock::holder(&path.join(LOCK_NAME)).is_some());
    second.keep(false);
    drop(second);
    assert!(!path.exists());
}

const KIND: [u8; 4] = *b"test";

fn sealed(path: &Path) -> Vec<u8> {
    let mut writer = SealedWriter::create(path, KIND, JobId(7)).unwrap();
    writer.put(&("a value", 1.5, vec![1_u64, 1 << 60])).unwrap();
    writer.put_records(&(0..1_000_000).collect::<Vec<u32>>()).unwrap();
    let bytes = writer.finish(false).unwrap();
    let written = fs::read(path).unwrap();
    assert_eq!(written.len() as u64, bytes);
    written
}

fn read(path: &Path) -> Result<usize, WorkError> {
    let mut reader = SealedReader::open(path, KIND)?;
    let _value: (String, f64, Vec<u64>) = reader.get()?;
    let records: Vec<u32> = reader.get_records()?;
    reader.finish()?;
    Ok(records.len())
}

#[test]
fn sealed_files_come_back_or_say_that_they_are_damaged() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("file");
    let bytes = sealed(&path);
    assert_eq!(read(&path).unwrap(), 1_000_000);
    assert_eq!(SealedReader::open(&path, KIND).unwrap().job, JobId(7));
    assert!(SealedReader::open(&path, *b"else").is_err());
    for at in (0..bytes.len()).step_by(40_009).chain([0, 9, 12, 33, 40, bytes.len() - 1]) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x40;
        fs::write(&path, &changed).unwrap();
        assert!(read(&path).is_err(), "{at}");
        fs::write(&path, &bytes[..at]).unwrap();
        assert!(read(&path).is_err(), "{at}");
    }
}

#[test]
fn an_unfinished_sealed_file_is_not_there() {
    let parent = tempfile::tempdir().unwrap();
    let mut writer = SealedWriter::create(&parent.path().join("file"), KIND, JobId(7)).unwrap();
    writer.put(&1_u64).unwrap();
    assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1);
    drop(writer);
    assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
}

#[test]
fn advice_fits_what_was_tried() {
    let advice = |action, kind: io::ErrorKind| WorkError::new(Path::new("x"), action, kind.into()).advice();
    assert_eq!(advice("written", io::ErrorKind::StorageFull), Some(("give its disk more space", true)));
    assert!(advice("made", io::ErrorKind::PermissionDenied).is_some_and(|(_, has_choice)| has_choice));
    assert_eq!(advice("read", io::ErrorKind::PermissionDenied), Some(("check its permissions", false)));
    assert_eq!(advice("read", io::ErrorKind::StorageFull), None);
    assert_eq!(advice("read", io::ErrorKind::NotFound), None);
}

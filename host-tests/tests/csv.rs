//! Damaged recordings are refused by the lab in one line that names file, line and field, with exit code 2, before
//! anything is printed on standard output; and no input whatever makes a reader panic.
#![cfg(not(target_os = "none"))]

use std::fs;
use std::io::{BufReader, Cursor, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use host_tests::input::{ImuReader, Table, MAX_LINE};
use proptest::prelude::*;

const HEADER: &str = "t_s,dtheta_x,dtheta_y,dtheta_z,dvel_x,dvel_y,dvel_z\n";
const ROW_1: &str = "0.01,0,0,1e-6,0,0,0.0978\n";
const ROW_2: &str = "0.02,0,0,1e-6,0,0,0.0978\n";

fn scratch(name: &str, content: &[u8]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("csv");
    fs::create_dir_all(&folder).unwrap();
    let path = folder.join(name);
    fs::write(&path, content).unwrap();
    path
}

/// Runs `lab replay` and returns the one line it must print.
fn refusal(args: &[&str]) -> String {
    refusal_of(
        Command::new(env!("CARGO_BIN_EXE_lab"))
            .arg("replay")
            .args(args),
    )
}

fn refusal_of(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(output.stdout.is_empty(), "nothing on standard output");
    assert_eq!(message.lines().count(), 1, "one line: {message:?}");
    message
}

/// The file is refused, and the message names it, this line and this field.
fn refused_at(name: &str, content: &str, line: usize, field: &str, what: &str) {
    let path = scratch(name, content.as_bytes());
    let path = path.to_str().unwrap();
    let message = refusal(&["--imu", path]);
    let place = format!("{path}:{line}: {field}: ");
    assert!(message.contains(&place), "{message:?} should say {place:?}");
    assert!(message.contains(what), "{message:?} should say {what:?}");
}

fn with(rows: &str) -> String {
    format!("{HEADER}{ROW_1}{ROW_2}{rows}")
}

#[test]
fn missing_column() {
    let text = "# note\nt_s,dtheta_x,dtheta_y,dvel_x,dvel_y,dvel_z\n0.01,0,0,0,0,0\n";
    refused_at("missing.csv", text, 2, "dtheta_z", "no such column");
}

#[test]
fn column_twice() {
    let text = HEADER.replace("dvel_y", "dvel_x");
    refused_at("twice.csv", &text, 1, "dvel_x", "twice");
}

#[test]
fn letter_in_a_number() {
    refused_at(
        "letter.csv",
        &with("0.03,0,0,1e-6,0,O.1,0.0978\n"),
        4,
        "dvel_y",
        "\"O.1\" is not a number",
    );
}

#[test]
fn nan_inf_and_overflow() {
    for (name, word) in [("nan", "NaN"), ("inf", "-inf"), ("huge", "1e999")] {
        let text = with(&format!("0.03,{word},0,1e-6,0,0,0.0978\n"));
        refused_at(&format!("{name}.csv"), &text, 4, "dtheta_x", "not");
    }
    refused_at(
        "nan_time.csv",
        &with("nan,0,0,1e-6,0,0,0.0978\n"),
        4,
        "t_s",
        "NaN",
    );
}

#[test]
fn empty_field() {
    refused_at(
        "hole.csv",
        &with("0.03,0,,1e-6,0,0,0.0978\n"),
        4,
        "dtheta_y",
        "is empty",
    );
}

#[test]
fn time_that_goes_back_or_stands_still() {
    refused_at(
        "back.csv",
        &with("0.005,0,0,1e-6,0,0,0.0978\n"),
        4,
        "t_s",
        "time goes back",
    );
    refused_at("still.csv", &with(ROW_2), 4, "t_s", "time stands still");
}

#[test]
fn empty_file_and_header_only() {
    refused_at("empty.csv", "", 1, "t_s", "empty");
    refused_at("notes.csv", "# only\n# notes\n", 3, "t_s", "empty");
    refused_at("header.csv", HEADER, 2, "t_s", "second sample");
}

#[test]
fn cut_off_at_any_byte_of_the_last_line() {
    // A file that ends inside its last line is cut off, even where the fields happen to read as numbers.
    let last = "0.03,0,0,1e-6,0,0,0.0978";
    let fields = [
        "t_s", "dtheta_x", "dtheta_y", "dtheta_z", "dvel_x", "dvel_y", "dvel_z",
    ];
    for length in 1..=last.len() {
        let cut = &last[..length];
        let field = fields[cut.matches(',').count()];
        refused_at("cut.csv", &with(cut), 4, field, "cut off");
    }
}

#[test]
fn wrong_number_of_fields() {
    refused_at(
        "few.csv",
        &with("0.03,0,0,1e-6,0,0\n"),
        4,
        "dvel_z",
        "6 fields, the header 7",
    );
    refused_at(
        "many.csv",
        &with("0.03,0,0,1e-6,0,0,0,0\n"),
        4,
        "field 8",
        "8 fields, the header 7",
    );
}

#[test]
fn a_line_of_a_gigabyte_is_not_read() {
    // A hole in the file: a gigabyte of zero bytes that takes no space on the disk.
    let path = scratch("gigabyte.csv", with("0.03,0,").as_bytes());
    let file = fs::OpenOptions::new().append(true).open(&path).unwrap();
    file.set_len(1 << 30).unwrap();
    // 256 MiB of address space: the line would not fit.
    let limited = "ulimit -v 262144; exec \"$0\" replay --imu \"$1\"";
    let mut command = Command::new("sh");
    command.args(["-c", limited, env!("CARGO_BIN_EXE_lab")]);
    let message = refusal_of(command.arg(&path));
    assert!(message.contains("gigabyte.csv:4: dtheta_y: "), "{message}");
    assert!(message.contains(&format!("longer than {MAX_LINE} bytes")));
}

#[test]
fn what_is_not_a_file() {
    let folder = scratch("x", b"").parent().unwrap().to_path_buf();
    for path in [folder.clone(), folder.join("absent.csv")] {
        let path = path.to_str().unwrap().to_owned();
        assert!(refusal(&["--imu", &path]).contains(&path));
    }
}

#[test]
fn the_other_files_are_checked_too() {
    let imu = scratch("good.csv", with("").as_bytes());
    let imu = imu.to_str().unwrap();
    for (flag, text, place) in [
        (
            "--gnss",
            "t_s,lat_deg,lon_deg,height_m\n1,95,0,0\n",
            ":2: lat_deg: ",
        ),
        (
            "--gnss",
            "t_s,lat_deg,lon_deg,height_m,v_e\n1,5,0,0,0\n",
            ":1: v_n: ",
        ),
        ("--ref", "t_s,qw,qx,qy,qz\n1,2,0,0,0\n", ":2: qw: "),
        ("--ref", "t_s,qw,qx,qy,qz\n1,inf,0,0,0\n", ":2: qw: "),
        ("--ref", "t_s,qw,qx,qy,qz\n1,nan,0,0,0\n", ":3: t_s: "),
        ("--rest", "t_s,at_rest\n1,0\n2,yes\n", ":3: at_rest: "),
        ("--rest", "t_s,at_rest\n1,0.5\n", ":2: at_rest: "),
    ] {
        let path = scratch("other.csv", text.as_bytes());
        let path = path.to_str().unwrap();
        let message = refusal(&["--imu", imu, flag, path]);
        assert!(message.contains(&format!("{path}{place}")), "{message}");
    }
}

#[test]
fn damage_is_quoted_so_that_it_stays_one_printable_line() {
    let mut text = with("0.03,0,0,1e-6,0,0,").into_bytes();
    text.extend_from_slice(b"\x1b[31m\r\xff\x00;;\n");
    let path = scratch("binary.csv", &text);
    let message = refusal(&["--imu", path.to_str().unwrap()]);
    assert!(message.contains("dvel_z") && message.contains("\\x1b[31m"));
    assert!(message.trim_end().chars().all(|c| !c.is_control()));
}

/// Reads everything from `bytes` through a buffer of `capacity` bytes.
fn read_all(bytes: &[u8], capacity: usize) -> Result<usize, String> {
    let source = BufReader::with_capacity(capacity, Cursor::new(bytes));
    let table = Table::new(Path::new("f"), source).map_err(|e| e.to_string())?;
    let mut count = 0;
    for sample in ImuReader::new(table).map_err(|e| e.to_string())? {
        let sample = sample.map_err(|e| e.to_string())?;
        let numbers = sample.delta_theta.iter().chain(&sample.delta_v);
        assert!(numbers
            .chain([&sample.t, &sample.dt])
            .all(|v| v.is_finite()));
        count += 1;
    }
    Ok(count)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), capacity in 1usize..64) {
        let alone = read_all(&bytes, capacity);
        prop_assert!(alone.is_err(), "random bytes have no header");
        let mut text = with("").into_bytes();
        text.extend_from_slice(&bytes);
        let _ = read_all(&text, capacity);
    }

    #[test]
    fn damaging_one_byte_never_panics_and_never_depends_on_the_buffer(
        at in 0usize..1000, byte in any::<u8>(), capacity in 1usize..64,
    ) {
        let mut bytes = with("").into_bytes();
        let at = at % bytes.len();
        bytes[at] = byte;
        prop_assert_eq!(read_all(&bytes, capacity), read_all(&bytes, 1 << 16));
    }

    #[test]
    fn what_was_written_is_read_back(
        rows in prop::collection::vec(prop::array::uniform6(-1e3..1e3f64), 2..20), capacity in 1usize..64,
    ) {
        let mut text = Vec::new();
        text.write_all(HEADER.as_bytes()).unwrap();
        for (i, row) in rows.iter().enumerate() {
            let [a, b, c, d, e, f] = row;
            writeln!(text, "{},{a},{b},{c},{d},{e},{f}", i as f64 * 0.01).unwrap();
        }
        let table = Table::new(Path::new("f"), BufReader::with_capacity(capacity, Cursor::new(&text))).unwrap();
        let read: Vec<[f64; 6]> = ImuReader::new(table).unwrap().map(|s| {
            let s = s.unwrap();
            let ([a, b, c], [d, e, f]) = (s.delta_theta, s.delta_v);
            [a, b, c, d, e, f]
        }).collect();
        prop_assert_eq!(read, rows);
    }
}

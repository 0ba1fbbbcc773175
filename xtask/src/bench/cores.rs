//! `cargo xtask bench --all`: the same work at opt-level "z" and on other cores, as a table in BENCHMARKS.md.

use anyhow::Result;

use super::measure::{self, Firmware, Row, PLAIN, SMALL, SMALLEST};
use super::table::{column, record};
use crate::qemu;
use crate::toolchain::Toolchain;

/// A navigator's rows; everything would take a smaller core's build minutes.
const FEW: &str = "cores";

const BUILDS: [Firmware; 6] = [
    SMALLEST,
    Firmware {
        machine: qemu::M7,
        ..PLAIN
    },
    Firmware {
        machine: qemu::M33,
        example: FEW,
        ..PLAIN
    },
    Firmware {
        machine: qemu::M33,
        example: FEW,
        ..SMALL
    },
    Firmware {
        machine: qemu::M0,
        example: FEW,
        ..PLAIN
    },
    Firmware {
        machine: qemu::M0,
        example: FEW,
        ..SMALL
    },
];

/// The navigator and its kernels in both scalars.
const HOST: Firmware = Firmware {
    machine: qemu::PC,
    example: FEW,
    ..PLAIN
};

/// Counts them.
pub fn rows(toolchain: &Toolchain) -> Result<Vec<Row>> {
    let plugin = measure::plugin()?;
    let mut rows = Vec::new();
    for build in &BUILDS {
        rows.extend(build.count(toolchain, &plugin)?.rows);
    }
    rows.extend(HOST.count_on_pc(toolchain, &plugin)?);
    Ok(rows)
}

/// Records them, in the order of the rows of the plain build.
pub fn write(toolchain: &Toolchain, plain: &[Row], others: &[Row]) -> Result<()> {
    let set_up = format!(
        "rustc {}, profile as above, no CPU flag; the Cortex-M0 multiplies floats in software. Each cell: instructions / bytes \
         of stack.",
        toolchain.release
    );
    let host = format!(
        "On the host (x86-64 with SSE2, opt-level 3, in `qemu-x86_64`):\n\n{}",
        on_host(others)
    );
    record(
        "bench --all",
        &format!("{set_up}\n\n{}\n\n{host}", text(plain, others)),
    )
}

fn text(plain: &[Row], others: &[Row]) -> String {
    let mut text = String::from("| work | scalar |");
    for build in &BUILDS {
        text += &format!(" {}, opt {} |", build.machine.core, build.opt);
    }
    text += &format!("\n|---|---|{}", "---|".repeat(BUILDS.len()));
    let first = plain.first();
    let of_first_build = |row: &&Row| {
        first.is_some_and(|first| row.opt == first.opt && row.cpu_flag == first.cpu_flag)
    };
    for row in plain.iter().filter(of_first_build) {
        text += &format!("\n| {} | {} |", row.work, row.scalar);
        for build in &BUILDS {
            text += &column(others, build, row);
        }
    }
    text
}

/// A line for each piece of work, a column for each scalar.
fn on_host(others: &[Row]) -> String {
    let host: Vec<Row> = others
        .iter()
        .filter(|row| row.core == HOST.machine.core)
        .cloned()
        .collect();
    let mut text = "| work | f32 | f64 |\n|---|---|---|".to_owned();
    for row in host.iter().filter(|row| row.scalar == "f32") {
        let double = Row {
            scalar: "f64".to_owned(),
            ..row.clone()
        };
        let cells = [row, &double].map(|row| column(&host, &HOST, row));
        text += &format!("\n| {} |{}", row.work, cells.concat());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(core: &'static str, opt: &'static str, instructions: u64) -> Row {
        Row {
            work: "step".to_owned(),
            core,
            opt,
            cpu_flag: String::new(),
            scalar: "f32".to_owned(),
            instructions,
            stack_bytes: 8,
        }
    }

    #[test]
    fn each_core_and_opt_level_has_its_column() {
        let plain = [row("Cortex-M4F", "3", 1), row("Cortex-M4F", "s", 2)];
        let others = [row("Cortex-M0", "s", 5000), row("Cortex-M4F", "z", 3)];
        let text = text(&plain, &others);
        assert_eq!(text.lines().count(), 3);
        let on_pc = |scalar: &str, instructions| Row {
            scalar: scalar.to_owned(),
            ..row("x86-64", "3", instructions)
        };
        let host = [
            on_pc("f32", 10),
            on_pc("f64", 20),
            row("Cortex-M4F", "3", 1),
        ];
        assert_eq!(
            on_host(&host).lines().last(),
            Some("| step | 10 / 8 | 20 / 8 |")
        );
        assert_eq!(
            text.lines().last(),
            Some("| step | f32 | 3 / 8 | | | | | 5,000 / 8 |")
        );
    }
}

//! Statistics as tables with a row per group, per window and per response.

use super::{FittedParameter, QuantityStatistics, Statistics, WellCondition, WellGroup};
use crate::tables::Kind::{Integer, Number, Text, Truth};
use crate::tables::{Cell, Heading, Kind, Table};

fn table(columns: &[(&str, Kind)], rows: Vec<Vec<Cell>>) -> Table {
    Table { headings: columns.iter().map(|(name, kind)| Heading { name: (*name).to_owned(), kind: *kind }).collect(), rows }
}

const CONDITION: [(&str, Kind); 8] = [
    ("specimen", Text),
    ("dpf", Number),
    ("strain", Text),
    ("treatment", Text),
    ("compound", Text),
    ("concentration", Number),
    ("concentration_unit", Text),
    ("control", Text),
];

fn condition(c: &WellCondition) -> [Cell; 8] {
    [
        c.specimen.as_str().into(),
        c.dpf.into(),
        c.strain.clone().into(),
        c.treatment.clone().into(),
        c.compound.clone().into(),
        c.concentration.into(),
        c.concentration_unit.clone().into(),
        c.control.clone().into(),
    ]
}

/// Columns that every row begins with: which quantity of which runs.
const OF: [(&str, Kind); 4] = [("quantity", Text), ("unit", Text), ("modes", Text), ("flagged", Text)];

fn of(statistics: &Statistics, quantity: &QuantityStatistics) -> [Cell; 4] {
    let flagged = match statistics.flagged {
        super::Flagged::Sound => "sound",
        super::Flagged::Included => "included",
        super::Flagged::Excluded => "excluded",
    };
    [quantity.name.as_str().into(), quantity.unit.as_str().into(), statistics.modes.join(";").into(), flagged.into()]
}

/// A row per group (`grouping` is `group`) and per compound over all concentrations (`compound`).
pub fn groups(statistics: &Statistics) -> Table {
    let numbers = [
        ("n", Integer),
        ("left_out", Integer),
        ("mean", Number),
        ("sd", Number),
        ("mean_95_low", Number),
        ("mean_95_high", Number),
        ("median", Number),
        ("mad", Number),
        ("wells", Text),
    ];
    let columns: Vec<_> = OF.into_iter().chain([("grouping", Text)]).chain(CONDITION).chain(numbers).collect();
    let row = |quantity: &QuantityStatistics, grouping: &str, group: &WellGroup| {
        let wells: Vec<String> = group.values.iter().map(|v| format!("{}/{}", v.run, v.well)).collect();
        let mut cells = of(statistics, quantity).to_vec();
        cells.push(grouping.into());
        cells.extend(condition(&group.condition));
        cells.extend([
            group.n.into(),
            group.left_out.into(),
            group.mean.into(),
            group.sd.into(),
            group.mean_interval_95.map(|i| i.low).into(),
            group.mean_interval_95.map(|i| i.high).into(),
            group.median.into(),
            group.mad.into(),
            wells.join(";").into(),
        ]);
        cells
    };
    let mut rows = Vec::new();
    for quantity in &statistics.quantities {
        rows.extend(quantity.groups.iter().map(|group| row(quantity, "group", group)));
        rows.extend(quantity.compounds.iter().map(|group| row(quantity, "compound", group)));
    }
    table(&columns, rows)
}

/// A row per quantity and run with controls.
pub fn windows(statistics: &Statistics) -> Table {
    let numbers = [("run", Text), ("positive", Integer), ("negative", Integer), ("z_prime", Number), ("reason", Text)];
    let columns: Vec<_> = OF.into_iter().chain(numbers).collect();
    let mut rows = Vec::new();
    for quantity in &statistics.quantities {
        for window in &quantity.windows {
            let mut cells = of(statistics, quantity).to_vec();
            cells.extend([
                window.run.as_str().into(),
                window.positive.into(),
                window.negative.into(),
                window.z_prime.into(),
                window.reason.clone().into(),
            ]);
            rows.push(cells);
        }
    }
    table(&columns, rows)
}

/// A row per quantity and compound with several concentrations.
pub fn responses(statistics: &Statistics) -> Table {
    let mut columns: Vec<(String, Kind)> = OF.iter().chain(&CONDITION).map(|(name, kind)| ((*name).to_owned(), *kind)).collect();
    // The unit of the doses stands in the condition's column; a response has no one concentration.
    columns.retain(|(name, _)| name != "concentration");
    columns.extend([
        ("n".to_owned(), Integer),
        ("ec50".to_owned(), Number),
        ("ec50_95_low".to_owned(), Number),
        ("ec50_95_high".to_owned(), Number),
    ]);
    for name in ["log10_ec50", "hill", "at_zero", "at_infinity"] {
        columns.extend(["", "_sd", "_95_low", "_95_high"].map(|end| (format!("{name}{end}"), Number)));
    }
    let last = [("ec50_is_within_doses", Truth), ("residual_sd", Number), ("p_no_effect", Number), ("reason", Text)];
    columns.extend(last.map(|(name, kind)| (name.to_owned(), kind)));
    let mut rows = Vec::new();
    for quantity in &statistics.quantities {
        for response in &quantity.responses {
            let c = WellCondition { concentration_unit: Some(response.concentration_unit.clone()), ..response.condition.clone() };
            let [specimen, dpf, strain, treatment, compound, _, unit, control] = condition(&c);
            let mut cells = of(statistics, quantity).to_vec();
            cells.extend([specimen, dpf, strain, treatment, compound, unit, control, response.points.len().into()]);
            let curve = response.curve.as_ref();
            cells.push(curve.map(|c| c.ec50).into());
            cells.extend([curve.map(|c| c.ec50_interval_95.low).into(), curve.map(|c| c.ec50_interval_95.high).into()]);
            let fitted: [fn(&super::DoseCurve) -> FittedParameter; 4] = [|c| c.log10_ec50, |c| c.hill, |c| c.at_zero, |c| c.at_infinity];
            for one in fitted.map(|of| curve.map(of)) {
                cells.extend(
                    [one.map(|f| f.value), one.map(|f| f.sd), one.map(|f| f.interval_95.low), one.map(|f| f.interval_95.high)]
                        .map(Cell::from),
                );
            }
            cells.extend([
                curve.map(|c| c.ec50_is_within_doses).into(),
                curve.map(|c| c.residual_sd).into(),
                curve.map(|c| c.p_no_effect).into(),
                response.reason.clone().into(),
            ]);
            rows.push(cells);
        }
    }
    Table { headings: columns.into_iter().map(|(name, kind)| Heading { name, kind }).collect(), rows }
}

// The columns of a foreign plate map: what each seems to be, as the daemon proposes it and the operator corrects it.
//
//   file ──columns──> proposal ──operator──> check with these columns ──> the plate, as it would be stored

import { proposeColumns, Refused } from "./api.ts";
import { element, setText, show } from "./dom.ts";
import { counted } from "./format.ts";
import type { Column, ColumnProposal, ConcentrationUnit, MappedColumn, ProposedColumn } from "./status.ts";

/** What a column may be, in the words of the page. */
const COLUMNS: Record<Column, string> = {
  well: "well",
  specimen: "specimen (larva, bead)",
  compound: "compound",
  concentration: "concentration",
  concentration_unit: "unit of the concentration",
  dpf: "age, dpf",
  strain: "strain",
  treatment: "treatment",
  control: "control (positive, negative)",
  replicate: "replicate",
};

/** `Position is the well, Dose the concentration in nM`; columns that are kept as they are are not named. Pure. */
export function mappingWords(columns: readonly MappedColumn[]): string {
  const named = columns.flatMap(({ heading, column, unit }) =>
    column == null
      ? []
      : [`${heading} is the ${COLUMNS[column].replace(/ \(.*/, "")}${unit == null ? "" : ` in ${unit}`}`],
  );
  return named.length === 0 ? "" : `Columns as chosen on this page: ${named.join(", ")}.`;
}

/** Whether the headings are those of another program or person. Pure. */
export function isForeign(proposal: ColumnProposal): boolean {
  return !proposal.columns.some((column) => column.column === "well" && column.is_own_name);
}

export class ColumnsView {
  readonly #box: HTMLFormElement;
  readonly #words: HTMLElement;
  readonly #table: HTMLElement;
  readonly #units: HTMLOptionElement[];
  #file: File | null = null;
  #proposal: ColumnProposal | null = null;

  /** `use` is called with what the operator says, or with null for what the headings say. */
  constructor(find: <T extends Element = HTMLElement>(id: string) => T, use: (columns: MappedColumn[] | null) => void) {
    this.#box = find("columns");
    this.#words = find("columns-words");
    this.#table = find("columns-table");
    // The units of the form for one well are those of the daemon.
    this.#units = [...find<HTMLSelectElement>("cell-unit").options];
    this.#box.addEventListener("submit", (event) => {
      event.preventDefault();
      use(this.#chosen());
    });
    find("columns-headings").addEventListener("click", () => {
      this.close();
      use(null);
    });
  }

  close(): void {
    this.#file = null;
    this.#proposal = null;
    show(this.#box, false);
  }

  /** Shows what the columns of a file seem to be. With `onlyForeign`: only if they are not carved's own. */
  async open(file: File, onlyForeign: boolean): Promise<void> {
    this.#file = file;
    try {
      const proposal = await proposeColumns(file);
      // Another file was chosen meanwhile, or its columns were closed.
      if (this.#file !== file) return;
      if (onlyForeign && isForeign(proposal) === false) return this.close();
      this.#proposal = proposal;
      this.#draw(proposal);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      // What is wrong with the file is said beside it.
      if (this.#file === file) this.close();
    }
  }

  #draw({ columns, line, rows }: ColumnProposal): void {
    setText(
      this.#words,
      `${this.#file?.name ?? ""}: ${counted(columns.length, "column")}, named in line ${line}, and ${counted(rows, "line")} below. ` +
        "Say what each column is. What carved does not read is kept as a column of your own.",
    );
    const head = element("tr", "");
    for (const name of ["Column", "First cells", "What it is", "Unit"]) {
      const cell = element("th", "", name);
      cell.scope = "col";
      head.append(cell);
    }
    const rowsMade = columns.map((column, i) => this.#row(column, i));
    this.#table.replaceChildren(element("thead", "", head), element("tbody", "", ...rowsMade));
    show(this.#box, true);
  }

  #row({ heading, column, unit, examples }: ProposedColumn, place: number): HTMLElement {
    const name = heading === "" ? `column ${place + 1}` : heading;
    const choice = element("select", "");
    choice.setAttribute("aria-label", `What ${name} is`);
    choice.dataset["column"] = heading;
    for (const [value, words] of [["", "a column of your own"], ...Object.entries(COLUMNS)] as const) {
      const option = element("option", "", words);
      option.value = value;
      option.selected = value === (column ?? "");
      choice.append(option);
    }
    const units = element("select", "");
    units.setAttribute("aria-label", `Unit of ${name}`);
    for (const known of this.#units) {
      const option = element("option", "", known.text === "" ? "in another column" : known.text);
      option.value = known.text;
      option.selected = known.text === (unit ?? "");
      units.append(option);
    }
    const showUnits = () => show(units, choice.value === "concentration");
    choice.addEventListener("change", showUnits);
    showUnits();
    const row = element("tr", "");
    const header = element("th", "", name);
    header.scope = "row";
    row.append(header);
    for (const content of [examples.join(", "), choice, units]) row.append(element("td", "", content));
    return row;
  }

  /** What the operator says that the columns are. */
  #chosen(): MappedColumn[] {
    const rows = [...this.#table.querySelectorAll("tbody tr")];
    return (this.#proposal?.columns ?? []).map(({ heading }, i) => {
      const [choice, units] = [...(rows[i]?.querySelectorAll("select") ?? [])];
      const column = (choice?.value || null) as Column | null;
      const unit = column === "concentration" && units ? units.value : "";
      return { heading, column, ...(unit === "" ? {} : { unit: unit as ConcentrationUnit }) };
    });
  }
}

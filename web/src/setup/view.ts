// What `carved setup --listen` serves at /v1/setup, and what the page derives from it.

export interface Choice {
  readonly value: string;
  readonly label: string;
}

export type Kind =
  | { readonly form: "text" | "steps" | "confirm" }
  | { readonly form: "number"; readonly unit: string; readonly range: readonly [number, number] }
  | { readonly form: "choice"; readonly options: readonly Choice[]; readonly open: boolean };

export interface Question {
  readonly number: number;
  readonly id: string;
  readonly title: string;
  readonly text: string;
  readonly kind: Kind;
  readonly default: string | null;
  readonly problem: string | null;
}

export interface View {
  readonly revision: number;
  readonly file: string;
  /** What the person has to know of an emulated rig. */
  readonly simulated: string | null;
  readonly stages: readonly string[];
  readonly stage: number;
  readonly question: Question | null;
  readonly doing: string | null;
  readonly taken: readonly [number, number] | null;
  readonly answers: readonly { readonly title: string; readonly answer: string }[];
  readonly log: readonly string[];
  readonly picture: number;
  readonly ended: { readonly is_done: boolean; readonly text: string } | null;
}

/** Whether an answer is typed, and not chosen. */
export function isTyped(kind: Kind): boolean {
  return kind.form !== "confirm" && !(kind.form === "choice" && !kind.open);
}

/** What is expected, in a few words below the field. */
export function hint(kind: Kind): string {
  switch (kind.form) {
    case "number":
      return `${kind.range[0]} to ${kind.range[1]} ${kind.unit}`;
    case "steps":
      return "for example 500, 200 x 16 or 200 x 32 x 5/2";
    case "choice":
      return kind.open ? "choose one, or type another" : "";
    default:
      return "";
  }
}

/** The heading above what happens now. */
export function heading(view: View): string {
  if (view.ended) return view.ended.is_done ? "The rig is set up" : "The set-up has ended";
  return view.question?.title ?? "Please wait";
}

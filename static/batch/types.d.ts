// The types of the page of a batch, known to its modules without an import.

export {};

declare global {
  type Cell = string | number | boolean | null | undefined;
  /** A result: the columns of the table by name, and what the page adds. */
  type Row = {
    [column: string]: Cell;
    name: string;
    place: number;
    outcome: string;
    command: string;
    review: string | null;
    thumbnail?: string;
    sought: string;
  };
}

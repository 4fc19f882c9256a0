// The types of page/dom.js: `make("input.small", {...})` gives an HTMLInputElement whose listeners know its events.

type TagOf<S extends string> = S extends `${infer Tag}#${string}` ? TagOf<Tag> : S extends `${infer Tag}.${string}` ? Tag : S;

/** The element that a selector such as "button#close.small" makes. */
export type ElementOf<S extends string> =
  TagOf<S> extends keyof HTMLElementTagNameMap ? HTMLElementTagNameMap[TagOf<S>] : HTMLElement;

type Listeners<S extends string> = {
  [Name in keyof HTMLElementEventMap]?: (event: HTMLElementEventMap[Name] & { target: ElementOf<S> }) => unknown;
};

type Value = string | number | boolean | null | undefined;

/** Attributes and listeners of an element; null, undefined and false leave an attribute out. */
export type Attributes<S extends string> = Listeners<S> & {
  data?: Record<string, string | number>;
  /** Names the control (data-id): a container that is rebuilt keeps its focus. */
  key?: string;
  tip?: string | null;
  label?: string | null;
  pressed?: boolean;
  text?: string;
  style?: Partial<CSSStyleDeclaration>;
} & { [attribute: string]: Value | object };

/** What an element holds: nodes and texts, also in lists; null, false, 0 and empty ones are left out. */
export type Child = Node | string | 0 | null | undefined | false | Child[];

/** The kinds of the elements that byId is asked for, where they are more than an HTMLElement. */
export interface Ids {
  canvas: HTMLCanvasElement;
  "scene-marks": HTMLCanvasElement;
  "source-canvas": HTMLCanvasElement;
  "path-box": HTMLInputElement;
  "open-cell": HTMLButtonElement;
  turned: HTMLButtonElement;
  viser: HTMLIFrameElement;
  menu: HTMLButtonElement;
  "brush-radius": HTMLInputElement;
  "teaching-time": HTMLInputElement;
  "progress-bar": HTMLProgressElement;
  "teaching-progress-bar": HTMLProgressElement;
  "hand-eye": HTMLInputElement;
  "capture-still": HTMLMeterElement;
  find: HTMLInputElement;
  outcome: HTMLSelectElement;
  review: HTMLSelectElement;
  command: HTMLDialogElement;
  exports: HTMLDialogElement;
  log: HTMLDialogElement;
  settings: HTMLDialogElement;
}

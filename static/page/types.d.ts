// The types that the modules of the page share, known to all of them without an import.

import type * as M from "./messages";
import type * as E from "./elements";
import type { FlatCanvas as FlatCanvasClass } from "../canvas/canvas.js";
import type { Looking as LookingClass } from "../canvas/look.js";
import type { Comparison as ComparisonClass } from "../canvas/compare.js";
import type { Pen as PenClass } from "../canvas/pen.js";
import type { Picture as PictureClass } from "../canvas/picture.js";
import type { Pyramid as PyramidClass } from "../canvas/pyramid.js";
import type { Page as PageClass } from "./page.js";
import type { SceneMarks as SceneMarksClass } from "./scene_marks.js";
import type { SidesPanel as SidesPanelClass } from "../panels/sides.js";
import type { Timeline as TimelineClass } from "../review/timeline.js";
import type { GarmentPanel as GarmentPanelClass } from "../garment/panel.js";
import type { DoubtsPanel as DoubtsPanelClass } from "../doubts/panel.js";
import type { Column as ColumnClass } from "../layout/column.js";
import type { Layout as LayoutClass } from "../layout/layout.js";

declare global {
  type State = M.PageState;
  /** A side of the item. */
  type SideName = M.PickInfo["side"];
  type ViewRow = M.ViewRow;
  type ActionRow = M.Action;
  type Legend = M.Legend;
  type Grid = M.Grid;
  type Pending = M.PendingInfo;
  type CurrentPick = M.PickInfo;
  type ListedPick = M.ListedPick;
  type GarmentPoint = M.GarmentPointInfo;
  type FoundGarment = M.FoundGarment;
  type ActiveStatus = M.ActiveStatus;
  type CaptureStatus = M.CaptureStatus;
  type Piece = M.FloatingPiece;
  type Note = M.Note;
  type ClientMessage = M.ClientMessage;
  type ServerMessage = M.ServerMessage;
  type HoverAnswer = M.HoverAnswer;
  type PreviewAnswer = M.PreviewAnswer;
  type PairsAnswer = M.PairsAnswer;
  type Measured = M.Measured;
  type GarmentPreview = M.GarmentPreview;
  type Found = M.ResultInfo;
  type Left = M.LeftOut;
  type Known = M.DiagnosticsInfo;
  type ZLine = M.ZAngleLine;
  type Pairs = M.ShownPairs;
  type Seen = M.SeenView;
  type SeenViews = M.SeenViews;
  type Doubt = M.Doubt;
  type Choice = M.Choice;
  type DoubtsInfo = M.DoubtsInfo;
  type ItemBox = M.ItemBox;
  type PixelValues = M.PixelValues;
  type Send = (message: ClientMessage) => boolean;
  type Notify = (level: Note["level"], text: string) => void;
  /** A row of a list of values: name, text, tooltip; false leaves it out. */
  type ValueRow = [name: string, text: string, tip?: string | null] | false | null | undefined | 0;

  /** A pick as text: what a page without a server has not may be left out. */
  type TextPick = Pick<M.PickInfo, "name" | "position_held_m" | "view_index" | "grip"> &
    Partial<Pick<M.PickInfo, "position_camera_m" | "normal_camera" | "angle_deg" | "miss_m">> & {
      normal_held: (number | null)[];
      source_rc: (number | null)[];
    };

  type PageHandlers = {
    send: Send;
    notify: Notify;
    run: (action: string) => void;
    /** Tell the server of a decision, by the name of its action. */
    decide: (action: string, more?: object) => void;
    /** Draw the page again. */
    show: (state: State) => void;
    /** Cloth was clicked. */
    pick: (u_m: number, v_m: number) => void;
    /** Move the proposal for good. */
    move: (by: By) => void;
  };
  /** A part of the page; each member may be left out. */
  interface Panel extends Partial<Tool> {
    /** Under which tests find it in `window.flatcloth`. */
    name?: string;
    /** Takes each state of the server. */
    update?(state: State): void;
    /** What it does, by the names of viewer/protocol/actions. */
    actions?: Record<string, (large: boolean) => void>;
    /** What it takes, by the type of the server's message. */
    messages?: { [T in ServerMessage["type"]]?: (message: Extract<ServerMessage, { type: T }>) => void };
    /** Draws over the pictures of the flattened view. */
    drawOver?(pen: Pen): void;
    /** Draws over the 3D scene. */
    drawInScene?(pen: Pen, place: PlaceInScene): void;
    /** Places of what it draws beyond the cloth, which are to be in sight. */
    around?(): UV[];
    /** Pixels (row, col) that it marks in the source image of a view. */
    sourceMarks?(view: number): UV[];
    /** Whether what lies at a place of the pane can be dragged. */
    holds?(at: PointerPlace): boolean;
    /** A click on the flattened view; true: it is taken. */
    click?(u_m: number, v_m: number): boolean;
    /** The pointer on the flattened view. */
    hover?(at: Place | null): void;
    /** The values under the pointer, null: none. */
    hovered?(answer: HoverAnswer | null): void;
    /** Its additional request about the point under the pointer. */
    asksHover?(): object;
    /** Escape was pressed; true: there was something to close. */
    escape?(): boolean;
    /** The proposal is being moved by so much. */
    moving?(by: By): void;
    /** The garment was turned over: the side that is shown now. */
    turned?(side: SideName): void;
    /** The proposal is drawn where the server has put it. */
    placed?(): void;
    /** A picture of the shape is drawn. */
    pictured?(): void;
    /** The connection is lost: pending requests stay unanswered. */
    disconnected?(): void;
    /** Another server process may answer from now on. */
    reconnected?(): void;
    /** Look at another view; null: at that of the page. */
    /** Show a pixel of a view. */
    lookAt?(view: number, rc: RC): void;
    /** Which of its actions are on, for their buttons. */
    pressed?: Record<string, boolean>;
    /** False: Accept waits, as its button now says. */
    mayAccept?(state: State): boolean;
  }
  type PanelEvent =
    | "update"
    | "click"
    | "hover"
    | "hovered"
    | "escape"
    | "moving"
    | "turned"
    | "placed"
    | "disconnected"
    | "reconnected"
    | "lookAt"
    | "drawOver"
    | "drawInScene"
    | "around"
    | "sourceMarks"
    | "pictured"
    | "cancel";
  type CallPanels<Result> = <E extends PanelEvent>(event: E, ...args: Parameters<NonNullable<Panel[E]>>) => Result;

  type Page = PageClass;
  type FlatCanvas = FlatCanvasClass;
  type Looking = LookingClass;
  type Comparison = ComparisonClass;
  type Picture = PictureClass;
  type Pyramid = PyramidClass;
  type SceneMarks = SceneMarksClass;
  type SidesPanel = SidesPanelClass;
  type Timeline = TimelineClass;
  type GarmentPanel = GarmentPanelClass;
  type DoubtsPanel = DoubtsPanelClass;
  type RightColumn = ColumnClass;
  type Layout = LayoutClass;
  type Child = E.Child;
  type Ids = E.Ids;
  type Attributes<S extends string> = E.Attributes<S>;
  type ElementOf<S extends string> = E.ElementOf<S>;
  type ChangeEvent = Event & { target: HTMLInputElement };
  type Listeners = { [Name in keyof HTMLElementEventMap]?: (event: HTMLElementEventMap[Name]) => unknown };

  type Context = CanvasRenderingContext2D;
  type Pen = PenClass;
  type Drawable = HTMLCanvasElement | OffscreenCanvas | ImageBitmap;
  type Numbers = ArrayLike<number>;
  type UV = [number, number];
  type RC = [number | null, number | null];
  type XYZ = [number, number, number];
  type RGB = [number, number, number];
  /** A place at which what the handles hold may belong; its title is shown `at` a place from the centre. */
  type Ghost = { title: string; motion: Motion; at: UV };
  /** What the handles hold: the ring's place from the centre, ghosts, and how an outline is drawn. */
  type Held = { arm: UV; ghosts: Ghost[]; draw: (motion: Motion) => void };
  /** A rotation (radians), then a shift (metres). */
  type Motion = [number, number, number];
  /** A motion of the proposal: by so much. */
  type By = { theta: number; u: number; v: number };
  /** A place of the pane, CSS pixels. */
  type Point = { x: number; y: number };
  /** A place of the plane, metres. */
  type Place = { u_m: number; v_m: number };
  /** The pointer, as the tools of the canvas get it. */
  type PointerPlace = { x: number; y: number; u: number; v: number };
  type Box = { left: number; top: number; right: number; bottom: number };
  type Rect = { x: number; y: number; w: number; h: number };

  /** A picture that is shown, where it lies. */
  type Shown = {
    revision: number;
    grid: Grid & { placement?: M.Rigid2 };
    box: Box;
    image: Drawable | Pyramid;
    address?: string;
    pixels?: Uint8ClampedArray;
    rim?: UV[];
    outline?: Pyramid;
  };
  type LabelLook = { font?: string; color?: string; alpha?: number; height?: number; width?: number | null };
  /** Where a point in space is seen on the overlay of the scene; null behind the eye. */
  type PlaceInScene = (point: XYZ) => Point | null;
  /** A mode of the pointer on the canvas: what takes a press gets what follows. */
  type Tool = {
    press(at: PointerPlace, withShift: boolean): boolean;
    /** `moved`: farther than in a click. */
    drag(at: PointerPlace, moved: boolean): void;
    /** False: it was a click, as on any cloth. */
    release(at: PointerPlace, moved: boolean): boolean | void;
    /** Two fingers zoom: what was pressed means nothing. */
    cancel?(): void;
  };
}

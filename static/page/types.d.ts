// The types that the modules of the page share, known to all of them without an import.

import type * as M from "/static/page/messages";
import type * as E from "/static/page/elements";
import type { FlatCanvas as FlatCanvasClass } from "/static/canvas/canvas.js";
import type { LayerList as LayerListClass } from "/static/canvas/layer_list.js";
import type { Looking as LookingClass } from "/static/canvas/look.js";
import type { Comparison as ComparisonClass } from "/static/canvas/compare.js";
import type { Picture as PictureClass } from "/static/canvas/picture.js";
import type { Pyramid as PyramidClass } from "/static/canvas/pyramid.js";
import type { KeyNudges as KeyNudgesClass } from "/static/canvas/nudges.js";
import type { Ruler as RulerClass } from "/static/canvas/ruler.js";
import type { Page as PageClass, Panel as PanelType } from "/static/page/page.js";
import type { SceneMarks as SceneMarksClass } from "/static/page/scene_marks.js";
import type { Toolbar as ToolbarClass } from "/static/page/toolbar.js";
import type { SidesPanel as SidesPanelClass } from "/static/panels/sides.js";
import type { Verdicts as VerdictsClass } from "/static/review/verdicts.js";
import type { GarmentPanel as GarmentPanelClass } from "/static/garment/panel.js";
import type { Layout as LayoutClass } from "/static/layout/layout.js";

declare global {
  type State = M.PageState;
  type ViewRow = M.ViewRow;
  type ActionRow = M.ActionRow;
  type Legend = M.Legend;
  type Grid = M.Grid;
  type Pending = M.PendingInfo;
  type CurrentPick = M.PickInfo;
  type ListedPick = M.ListedPick;
  type GarmentPoint = M.GarmentPointInfo;
  type FoundGarment = M.FoundGarment;
  type CaptureStatus = M.CaptureStatus;
  type Piece = M.FloatingPiece;
  type Note = M.Note;
  type ClientMessage = M.ClientMessage;
  type ServerMessage = M.ServerMessage;
  type HoverAnswer = M.HoverAnswer;
  type PixelValues = M.PixelValues;
  type FrameInfo = M.FrameInfo;
  type Send = (message: ClientMessage) => boolean;
  type Notify = (level: "info" | "warning" | "error", text: string) => void;

  type Page = PageClass;
  type Panel = PanelType;
  type FlatCanvas = FlatCanvasClass;
  type LayerList = LayerListClass;
  type Looking = LookingClass;
  type Comparison = ComparisonClass;
  type Picture = PictureClass;
  type Pyramid = PyramidClass;
  type KeyNudges = KeyNudgesClass;
  type Ruler = RulerClass;
  type SceneMarks = SceneMarksClass;
  type Toolbar = ToolbarClass;
  type SidesPanel = SidesPanelClass;
  type Verdicts = VerdictsClass;
  type GarmentPanel = GarmentPanelClass;
  type Layout = LayoutClass;
  type Child = E.Child;
  type Ids = E.Ids;
  type Attributes<S extends string> = E.Attributes<S>;
  type ElementOf<S extends string> = E.ElementOf<S>;
  type ChangeEvent = Event & { target: HTMLInputElement };
  type Listeners = { [Name in keyof HTMLElementEventMap]?: (event: HTMLElementEventMap[Name]) => unknown };

  type Context = CanvasRenderingContext2D;
  type Style = CSSStyleDeclaration;
  type Drawable = HTMLCanvasElement | OffscreenCanvas | ImageBitmap;
  type Numbers = ArrayLike<number>;
  type UV = [number, number];
  type RC = [number | null, number | null];
  type XYZ = [number, number, number];
  type RGB = [number, number, number];
  /** A rotation (radians), then a shift (metres). */
  type Motion = [number, number, number];
  /** A motion of the proposal: by so much. */
  type By = { theta: number; u: number; v: number };
  /** A place of the pane, CSS pixels. */
  type Point = { x: number; y: number };
  /** A place of the plane, metres. */
  type Place = { u_m: number; v_m: number };
  /** The pointer, as the tools of the canvas get it. */
  type PointerPlace = { x: number; y: number; u: number; v: number; shift: boolean };
  type Box = { left: number; top: number; right: number; bottom: number };
  type Rect = { x: number; y: number; w: number; h: number };

  /** How a layer is looked at; low and high are shares of its range. */
  type LayerLook = { map: string; low: number; high: number; shown: boolean; opacity: number; blending: GlobalCompositeOperation };
  /** A picture that is shown, where it lies. */
  type Shown = {
    revision: number;
    grid: Grid & { placement?: M.Placement };
    box: Box;
    image: Drawable | Pyramid;
    address?: string;
    alpha?: Uint8Array;
    outline?: Pyramid;
  };
  /** Draws over the pictures of the flattened view. */
  type Drawer = (canvas: FlatCanvas, context: Context, style: Style) => void;
  /** Where a point in space is seen on the overlay of the scene; null behind the eye. */
  type PlaceInScene = (point: XYZ) => Point | null;
  type SceneDrawer = (context: Context, style: Style, place: PlaceInScene) => void;
  /** A mode of the pointer on the canvas. */
  type Tool = {
    press(at: PointerPlace): boolean;
    drag(at: PointerPlace): void;
    release(at: PointerPlace): void;
  };
}

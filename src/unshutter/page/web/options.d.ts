// The module that the program makes of its options (page/settings.py).
import type { Schema } from "./types.js";

export const photo: Record<string, Schema>;
export const clip: Record<string, Schema>;
export const videos: string[]; // the endings of their names

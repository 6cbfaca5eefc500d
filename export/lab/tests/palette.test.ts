import { describe, expect, it } from "vitest";
import { BOUNCE_COLOURS, isLight } from "../src/ui/palette";

describe("letters on colours", () => {
  it("are dark on light ones", () => {
    expect(["1", "2", "4+", "2+"].map((bounce) => isLight(BOUNCE_COLOURS[bounce] ?? ""))).toEqual([
      false,
      true,
      true,
      true,
    ]);
    expect(isLight("")).toBe(false);
  });
});

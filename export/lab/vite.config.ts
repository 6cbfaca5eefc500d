import { defineConfig } from "vitest/config";

// Addresses are relative, so that any file server shows the folder, wherever it lies.
export default defineConfig({
  base: "./",
  build: {
    outDir: "../../build/lab",
    emptyOutDir: true,
    target: "es2022",
    chunkSizeWarningLimit: 900,
  },
  worker: { format: "es" },
  test: { include: ["tests/**/*.test.ts"], environment: "node" },
});

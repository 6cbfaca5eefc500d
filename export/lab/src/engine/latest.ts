/** Work that follows the newest request: one at a time, and what was asked meanwhile only once. */

export class Latest<T> {
  private wanted: { value: T } | null = null;
  private running = false;
  private generation = 0;

  /** `work` gives up as soon as `stale()`. */
  constructor(
    private readonly work: (value: T, stale: () => boolean) => Promise<void>,
    private readonly failed: (error: Error) => void,
  ) {}

  request(value: T): void {
    this.wanted = { value };
    this.generation++;
    if (!this.running) void this.drain();
  }

  get busy(): boolean {
    return this.running;
  }

  private async drain(): Promise<void> {
    this.running = true;
    while (this.wanted) {
      const { value } = this.wanted;
      this.wanted = null;
      const mine = this.generation;
      try {
        await this.work(value, () => this.generation !== mine);
      } catch (error) {
        if (this.generation === mine) this.failed(error instanceof Error ? error : new Error(String(error)));
      }
    }
    this.running = false;
  }
}

/** Renders glTF scenes on a Lumifold farm, by the coordinator's calls over HTTP. */

export interface FarmOptions {
  /** Of the farm, if the address is no link of `lumifold page`. */
  token?: string;
  /** Certificates in PEM, such as the farm's ca.pem; by default those of Node. */
  ca?: string | Buffer;
  /** Seconds for which calls wait for a farm that is away; 30 by default. */
  patience?: number;
}

export interface RenderOptions {
  size?: [width: number, height: number];
  samples?: number;
  frames?: number | number[];
  camera?: string;
  method?: string;
  maxBounces?: number;
  seed?: number | bigint;
  framesPerSecond?: number;
  name?: string;
  user?: string;
  priority?: number;
  tags?: string[];
  /** The job begins when these are done. */
  after?: Job[];
  paused?: boolean;
  /** A URL that is called when the job has ended, at a host that the farm's operator allows. */
  webhook?: string;
  /** Further fields of JobSpec (proto/lumifold/v1/job.proto), which count more. */
  spec?: Record<string, unknown>;
  /** Called with bytes that were sent, and bytes in all. */
  uploaded?: (done: number, total: number) => void;
}

export interface Status {
  id: string;
  name: string;
  /** "submitted", "planned", "running", "filtering", "paused", "done", "done with gaps", "failed" or "cancelled". */
  state: string;
  error: string;
  /** Every frame can be saved, but for those that were skipped. */
  isDone: boolean;
  hasEnded: boolean;
  /** Of its samples, 0 to 1. */
  progress: number;
  framesDone: number;
  framesTotal: number;
  /** All that the farm says: JobStatus as JSON. */
  message: Record<string, unknown>;
}

export declare class FarmError extends Error {
  /** That of the protocol, such as "NOT_FOUND"; "UNAVAILABLE" where no farm answers. */
  code: string;
}

export declare class JobError extends Error {
  status: Status;
}

export declare class Farm {
  constructor(address: string, options?: FarmOptions);
  render(scene: string, options?: RenderOptions): Promise<Job>;
  job(id: string): Job;
  jobs(options?: {user?: string}): AsyncGenerator<Status>;
}

export declare class Job {
  readonly id: string;
  status(): Promise<Status>;
  /** Throws JobError where the job fails or is cancelled. */
  wait(options?: {progress?: (status: Status) => void; signal?: AbortSignal}): Promise<Status>;
  save(path: string, frame?: number): Promise<void>;
  saveAll(path: string): Promise<void>;
  explain(): Promise<{code: string; text: string}[]>;
  cancel(): Promise<Status>;
  pause(): Promise<Status>;
  resume(): Promise<Status>;
  retry(options?: {frames?: number[]; skip?: boolean}): Promise<Status>;
  delete(): Promise<void>;
}

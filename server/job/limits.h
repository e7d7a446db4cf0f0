#pragma once

#include <cstddef>
#include <cstdint>

/// Limits of a submission and of what is kept of a job, in one place. NormaliseJobSpec checks those of a
/// spec.
namespace lumifold::job {

/// Picture: edge length, samples of a pixel, and camera samples of all frames together (they are counted in
/// 64 bits).
inline constexpr int kMaxEdge = 16384;
inline constexpr int kMaxSamples = 1 << 20;
inline constexpr int64_t kMaxJobSamples = int64_t{1} << 60;
inline constexpr int kMaxBounces = 1024;

/// Pixels.
inline constexpr float kMaxPixelFilterWidth = 8;

/// Pixels of a picture with adaptive sampling: each estimate filters the whole of it in memory.
inline constexpr int64_t kMaxAdaptivePixels = int64_t{1} << 22;

/// Units: edge length of a tile, units of a frame, frames of a job. The scheduler's tables are sized for
/// them.
inline constexpr int kMinTileSize = 8;
inline constexpr int kMaxTileSize = 512;
inline constexpr int64_t kMaxUnitsPerFrame = int64_t{1} << 27;
inline constexpr int kMaxFrames = 100'000;

/// Ranges of frames of a job besides the first one.
inline constexpr int kMaxFrameRanges = 1024;

/// Files of a scene: bytes of one of them, its URI, and their number.
inline constexpr uint64_t kMaxAssetBytes = uint64_t{1} << 40;
inline constexpr size_t kMaxUriBytes = 4096;
inline constexpr int kMaxDependencies = 16'384;

/// Jobs that a job may wait for.
inline constexpr int kMaxPrerequisites = 64;

/// Names: camera, display name and method, and the request id.
inline constexpr size_t kMaxNameBytes = 255;
inline constexpr size_t kMaxRequestIdBytes = 128;

/// Bytes of a whole normalised spec: what a message of rpc::kMaxMessageBytes (4 MiB) holds beside a
/// submission's other fields.
inline constexpr size_t kMaxSpecBytes = (size_t{4} << 20) - (size_t{128} << 10);

/// Decisions that a submission may force, and bytes of one. Bytes of a plan, of which most are the order of
/// tiles, and of a text in it.
inline constexpr int kMaxForced = 32;
inline constexpr size_t kMaxForcedBytes = 64;
inline constexpr size_t kMaxPlanBytes = size_t{64} << 10;
inline constexpr size_t kMaxPlanTextBytes = 512;

/// Maximum number of warnings that are stored for a job; further ones are counted. Each has at most
/// rpc::kMaxWarningBytes, so a job's status has at most 51 KiB of them.
inline constexpr int kMaxJobWarnings = 100;

}  // namespace lumifold::job

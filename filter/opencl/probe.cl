// What the bits of all kernels rest on; it is the first part of each program.
#ifdef __OPENCL_VERSION__
#pragma OPENCL FP_CONTRACT OFF
#endif

// Quotient, root, product and sum, and a denormal, of each pair of numbers.
__kernel void Probe(int count, __global const float* a, __global const float* b, __global float* results) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count) return;
  const float x = a[item], y = b[item];
  results[4 * item] = x / y;
  results[4 * item + 1] = sqrt(x);
  results[4 * item + 2] = x * y + x;
  results[4 * item + 3] = x * y * 1e-39f;
}

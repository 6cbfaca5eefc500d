// A vector register of numbers, in the vector types of gcc and clang, and the functions of Sleef that come with torch.
#include <cstdint>
#include <cstring>

#if defined(__AVX512F__)
constexpr int BYTES = 64;
#elif defined(__AVX2__)
constexpr int BYTES = 32;
#else
constexpr int BYTES = 16;
#endif
constexpr int LANES = BYTES / (WIDE ? 8 : 4);

typedef float F __attribute__((vector_size(4 * LANES)));
typedef double D __attribute__((vector_size(8 * LANES)));
typedef int32_t I __attribute__((vector_size(4 * LANES)));
typedef int64_t W __attribute__((vector_size(8 * LANES)));
typedef char B __attribute__((vector_size(LANES)));
#if WIDE
typedef W M;
#else
typedef I M;
#endif
typedef float FU __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef double DU __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
typedef int32_t IU __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef int64_t WU __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
typedef char BU __attribute__((vector_size(LANES), aligned(1), may_alias));
#if defined(__GNUC__) && !defined(__clang__)
#define UNOPTIMISED __attribute__((optimize("O0")))
#else
#define UNOPTIMISED
#endif
#define IN static inline __attribute__((always_inline))

// x − 0, not x + 0: the sign of −0 is kept.
IN F all_f(float x) { return x - F{}; }
IN D all_d(double x) { return x - D{}; }
IN I all_i(int32_t x) { return x + I{}; }
IN W all_l(int64_t x) { return x + W{}; }
IN M all_b(int64_t x) { return (decltype(M{}[0] + M{}[0]))x + M{}; }

IN F load_f(const void* p, int64_t i) { return *(const FU*)((const float*)p + i); }
IN D load_d(const void* p, int64_t i) { return *(const DU*)((const double*)p + i); }
IN I load_i(const void* p, int64_t i) { return *(const IU*)((const int32_t*)p + i); }
IN W load_l(const void* p, int64_t i) { return *(const WU*)((const int64_t*)p + i); }
IN M load_b(const void* p, int64_t i) { return __builtin_convertvector(*(const BU*)((const char*)p + i), M) != 0; }
IN void store_f(void* p, int64_t i, F x) { *(FU*)((float*)p + i) = x; }
IN void store_d(void* p, int64_t i, D x) { *(DU*)((double*)p + i) = x; }
IN void store_i(void* p, int64_t i, I x) { *(IU*)((int32_t*)p + i) = x; }
IN void store_l(void* p, int64_t i, W x) { *(WU*)((int64_t*)p + i) = x; }

IN M mask(I x) { return __builtin_convertvector(x, M); }
IN M mask(W x) { return __builtin_convertvector(x, M); }
IN F pick(M m, F a, F b) { return __builtin_convertvector(m, I) ? a : b; }
IN I pick(M m, I a, I b) { return __builtin_convertvector(m, I) ? a : b; }
IN D pick(M m, D a, D b) { return __builtin_convertvector(m, W) ? a : b; }
IN W pick(M m, W a, W b) { return __builtin_convertvector(m, W) ? a : b; }
#if WIDE
IN M pick_b(M m, M a, M b) { return (m & a) | (~m & b); }
#endif

IN D f_to_d(F x) { return __builtin_convertvector(x, D); }
IN F d_to_f(D x) { return __builtin_convertvector(x, F); }
IN F i_to_f(I x) { return __builtin_convertvector(x, F); }
IN D i_to_d(I x) { return __builtin_convertvector(x, D); }
IN F l_to_f(W x) { return __builtin_convertvector(x, F); }
IN D l_to_d(W x) { return __builtin_convertvector(x, D); }
IN I l_to_i(W x) { return __builtin_convertvector(x, I); }
IN W i_to_l(I x) { return __builtin_convertvector(x, W); }
IN I f_to_i(F x) { return __builtin_convertvector(x, I); }
IN W f_to_l(F x) { return __builtin_convertvector(x, W); }
IN F b_to_f(M m) { return pick(m, all_f(1), all_f(0)); }
IN D b_to_d(M m) { return pick(m, all_d(1), all_d(0)); }
IN I b_to_i(M m) { return pick(m, all_i(1), all_i(0)); }
IN W b_to_l(M m) { return pick(m, all_l(1), all_l(0)); }
IN M f_to_b(F x) { return mask(x != 0); }
IN M d_to_b(D x) { return mask(x != 0); }
IN M i_to_b(I x) { return mask(x != 0); }
IN M l_to_b(W x) { return mask(x != 0); }

// The larger and the smaller; NaN if one is.
IN F m_max(F a, F b) { return (a > b) | (a != a) ? a : b; }
IN D m_max(D a, D b) { return (a > b) | (a != a) ? a : b; }
IN F m_min(F a, F b) { return (a < b) | (a != a) ? a : b; }
IN D m_min(D a, D b) { return (a < b) | (a != a) ? a : b; }
IN I m_max(I a, I b) { return a > b ? a : b; }
IN I m_min(I a, I b) { return a < b ? a : b; }
IN F m_abs(F x) { return (F)((I)x & 0x7fffffff); }
IN D m_abs(D x) { return (D)((W)x & 0x7fffffffffffffffll); }

template <class V, int N> union Parts { V whole; decltype(V{}[0] + V{}[0]) each[N]; };

#define ONE(name, call) \
    IN F m_##name(F x) { F y; for (int i = 0; i < LANES; i++) y[i] = call##f(x[i]); return y; } \
    IN D m_##name(D x) { D y; for (int i = 0; i < LANES; i++) y[i] = call(x[i]); return y; }

#if defined(__AVX512F__)
typedef float F16 __attribute__((vector_size(64)));
typedef float F8 __attribute__((vector_size(32)));
typedef double D8 __attribute__((vector_size(64)));
#define SLEEF1(name, sleef, precision) \
    extern "C" F16 Sleef_##sleef##f16_##precision(F16); \
    extern "C" F8 Sleef_##sleef##f8_##precision(F8); \
    extern "C" D8 Sleef_##sleef##d8_##precision(D8);
#if WIDE
#define FLOAT_OF(sleef, precision) Sleef_##sleef##f8_##precision
#else
#define FLOAT_OF(sleef, precision) Sleef_##sleef##f16_##precision
#endif
#define HALVES(sleef, precision, x) \
    union { D whole; D8 part[sizeof(D) / 64]; } u{x}; \
    for (auto& p : u.part) p = Sleef_##sleef##d8_##precision(p); \
    return u.whole;
#define FUNCTION(name, sleef, precision) \
    SLEEF1(name, sleef, precision) \
    IN F m_##name(F x) { return FLOAT_OF(sleef, precision)(x); } \
    IN D m_##name(D x) { HALVES(sleef, precision, x) }
#else
#error "not yet"
#endif
FUNCTION(exp, exp, u10)
FUNCTION(log, log, u10)
FUNCTION(sin, sin, u10)
FUNCTION(cos, cos, u10)
FUNCTION(tan, tan, u10)
FUNCTION(atan, atan, u10)
FUNCTION(tanh, tanh, u10)
IN F m_floor(F x) { F y; for (int i = 0; i < LANES; i++) y[i] = __builtin_floorf(x[i]); return y; }
IN D m_floor(D x) { D y; for (int i = 0; i < LANES; i++) y[i] = __builtin_floor(x[i]); return y; }

#include <immintrin.h>
#if FAST && !WIDE
// 1 / b by an estimate of 14 bits and one step of Newton's; for 0 and infinity the estimate is right, and the step is not.
IN F inverse(F b) {
    const __m512 r = _mm512_rcp14_ps((__m512)b);
    const F s = (F)r + (F)r * (1 - b * (F)r);
    return (F)_mm512_mask_mov_ps((__m512)s, _mm512_fpclass_ps_mask((__m512)b, 0x1e), r);
}
IN F quotient(F a, F b) { return a * inverse(b); }
IN F m_sqrt(F x) {
    const F r = (F)_mm512_rsqrt14_ps((__m512)x);
    const F s = x * r;
    const F t = s + 0.5f * r * (x - s * s);
    return (F)_mm512_mask_mov_ps((__m512)t, _mm512_fpclass_ps_mask((__m512)x, 0x0e), (__m512)x);
}
#else
IN F quotient(F a, F b) { return a / b; }
#if WIDE
IN F m_sqrt(F x) { return (F)_mm256_sqrt_ps((__m256)x); }
#else
IN F m_sqrt(F x) { return (F)_mm512_sqrt_ps((__m512)x); }
#endif
#endif
IN D quotient(D a, D b) { return a / b; }
IN D m_sqrt(D x) {
    union { D whole; __m512d part[sizeof(D) / 64]; } u{x};
    for (auto& p : u.part) p = _mm512_sqrt_pd(p);
    return u.whole;
}

// Σ a_i b_i in four sums side by side, which do not wait for each other.
template <class V, class T> static __attribute__((noinline)) V dot(const V* a, const T* b, int64_t step, int64_t count) {
    V sum[4] = {V{}, V{}, V{}, V{}};
    int64_t i = 0;
    for (; i + 4 <= count; i += 4) for (int j = 0; j < 4; j++) sum[j] += a[i + j] * b[(i + j) * step];
    for (; i < count; i++) sum[0] += a[i] * b[i * step];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

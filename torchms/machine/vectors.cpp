// A vector register of numbers, in the vector types of gcc and clang, and the functions of Sleef that come with torch.
#include <cstdint>
#include <cstring>

#if defined(__AVX512F__)
#define BYTES 64
#elif defined(__AVX2__)
#define BYTES 32
#else
#define BYTES 16
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
#define UNMIXED __attribute__((noinline, noclone))
#else
#define UNOPTIMISED
#define UNMIXED __attribute__((noinline))
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
// Of a bound, which is no NaN, and a number: one instruction, which gives the second where a comparison fails.
IN F m_max_of(F bound, F x) { return bound > x ? bound : x; }
IN D m_max_of(D bound, D x) { return bound > x ? bound : x; }
IN F m_min_of(F bound, F x) { return bound < x ? bound : x; }
IN D m_min_of(D bound, D x) { return bound < x ? bound : x; }
IN I m_max(I a, I b) { return a > b ? a : b; }
IN I m_min(I a, I b) { return a < b ? a : b; }
IN F m_abs(F x) { return (F)((I)x & 0x7fffffff); }
IN D m_abs(D x) { return (D)((W)x & 0x7fffffffffffffffll); }

typedef uint32_t U __attribute__((vector_size(4 * LANES)));
IN I m_ushr(I x, I k) { return (I)((U)x >> (U)k); }

template <class V, int N> union Parts { V whole; decltype(V{}[0] + V{}[0]) each[N]; };

// A function of Sleef takes a whole register: S floats, T doubles.
#if BYTES == 64
#define SLEEF_D(name, precision) Sleef_##name##d8_##precision
#elif BYTES == 32
#define SLEEF_D(name, precision) Sleef_##name##d4_##precision
#else
#define SLEEF_D(name, precision) Sleef_##name##d2_##precision
#endif
#if BYTES == 64 && !WIDE
#define SLEEF_F(name, precision) Sleef_##name##f16_##precision
typedef float S __attribute__((vector_size(64)));
#elif BYTES == 64 || (BYTES == 32 && !WIDE)
#define SLEEF_F(name, precision) Sleef_##name##f8_##precision
typedef float S __attribute__((vector_size(32)));
#else
#define SLEEF_F(name, precision) Sleef_##name##f4_##precision
typedef float S __attribute__((vector_size(16)));
#endif
typedef double T __attribute__((vector_size(BYTES)));
#define FUNCTION(name, sleef, precision) \
    extern "C" S SLEEF_F(sleef, precision)(S); \
    extern "C" T SLEEF_D(sleef, precision)(T); \
    IN F m_##name(F x) { \
        S s{}; \
        std::memcpy(&s, &x, sizeof x); \
        s = SLEEF_F(sleef, precision)(s); \
        std::memcpy(&x, &s, sizeof x); \
        return x; \
    } \
    IN D m_##name(D x) { \
        for (int k = 0; k < int(sizeof(D) / BYTES); k++) { \
            T s; \
            std::memcpy(&s, (char*)&x + k * BYTES, BYTES); \
            s = SLEEF_D(sleef, precision)(s); \
            std::memcpy((char*)&x + k * BYTES, &s, BYTES); \
        } \
        return x; \
    }
#define FUNCTION2(name, sleef, precision) \
    extern "C" S SLEEF_F(sleef, precision)(S, S); \
    extern "C" T SLEEF_D(sleef, precision)(T, T); \
    IN F m_##name(F x, F y) { \
        S s{}, t{}; \
        std::memcpy(&s, &x, sizeof x); std::memcpy(&t, &y, sizeof y); \
        s = SLEEF_F(sleef, precision)(s, t); \
        std::memcpy(&x, &s, sizeof x); \
        return x; \
    } \
    IN D m_##name(D x, D y) { \
        for (int k = 0; k < int(sizeof(D) / BYTES); k++) { \
            T s, t; \
            std::memcpy(&s, (char*)&x + k * BYTES, BYTES); std::memcpy(&t, (char*)&y + k * BYTES, BYTES); \
            s = SLEEF_D(sleef, precision)(s, t); \
            std::memcpy((char*)&x + k * BYTES, &s, BYTES); \
        } \
        return x; \
    }
#define EACH(name) \
    IN F m_##name(F x) { for (int i = 0; i < LANES; i++) x[i] = __builtin_##name##f(x[i]); return x; } \
    IN D m_##name(D x) { for (int i = 0; i < LANES; i++) x[i] = __builtin_##name(x[i]); return x; }
#if BYTES == 16 && !defined(__aarch64__)
// torch has no Sleef for registers so short: one number after the other.
#undef FUNCTION
#undef FUNCTION2
#define FUNCTION(name, sleef, precision) EACH(name)
#define FUNCTION2(name, sleef, precision) \
    IN F m_##name(F x, F y) { for (int i = 0; i < LANES; i++) x[i] = __builtin_##name##f(x[i], y[i]); return x; } \
    IN D m_##name(D x, D y) { for (int i = 0; i < LANES; i++) x[i] = __builtin_##name(x[i], y[i]); return x; }
#endif
FUNCTION(exp, exp, u10)
FUNCTION(exp2, exp2, u10)
FUNCTION(expm1, expm1, u10)
FUNCTION(log, log, u10)
FUNCTION(log2, log2, u10)
FUNCTION(log1p, log1p, u10)
FUNCTION(sin, sin, u10)
FUNCTION(cos, cos, u10)
FUNCTION(tan, tan, u10)
FUNCTION(asin, asin, u10)
FUNCTION(acos, acos, u10)
FUNCTION(atan, atan, u10)
FUNCTION(sinh, sinh, u10)
FUNCTION(cosh, cosh, u10)
FUNCTION(tanh, tanh, u10)
FUNCTION(erf, erf, u10)
FUNCTION2(atan2, atan2, u10)
FUNCTION2(pow, pow, u10)
EACH(floor)
EACH(ceil)
EACH(trunc)

#if BYTES >= 32
#include <immintrin.h>
#endif
#if BYTES == 64 && FAST && !WIDE
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
IN F m_inverse_root(F x) {
    const __m512 r = _mm512_rsqrt14_ps((__m512)x);
    const F s = (F)r + 0.5f * (F)r * (1 - x * (F)r * (F)r);
    return (F)_mm512_mask_mov_ps((__m512)s, _mm512_fpclass_ps_mask((__m512)x, 0x0e), r);
}
#elif BYTES == 32 && FAST && !WIDE
// By an estimate of 12 bits. Quotients and roots alone take no longer than their estimates and steps.
IN F quotient(F a, F b) { return a / b; }
IN F m_sqrt(F x) { return (F)_mm256_sqrt_ps((__m256)x); }
IN F m_inverse_root(F x) {
    const F r = (F)_mm256_rsqrt_ps((__m256)x);
    const F s = r + 0.5f * r * (1 - x * r * r);
    // For zero and infinity the step gives NaN.
    return (F)_mm256_blendv_ps((__m256)s, (__m256)r, _mm256_cmp_ps((__m256)s, (__m256)s, _CMP_UNORD_Q));
}
#else
IN F quotient(F a, F b) { return a / b; }
#if BYTES == 64 && !WIDE
IN F m_sqrt(F x) { return (F)_mm512_sqrt_ps((__m512)x); }
#elif BYTES == 64 || (BYTES == 32 && !WIDE)
IN F m_sqrt(F x) { return (F)_mm256_sqrt_ps((__m256)x); }
#elif BYTES == 32
IN F m_sqrt(F x) { return (F)_mm_sqrt_ps((__m128)x); }
#else
IN F m_sqrt(F x) { for (int i = 0; i < LANES; i++) x[i] = __builtin_sqrtf(x[i]); return x; }
#endif
#endif
IN D quotient(D a, D b) { return a / b; }
#if FAST && !WIDE
// Sine and cosine together: x less the nearest multiple of π / 2 in three parts, and polynomials (1 to 2 units in the last place).
struct Turn { F sin, cos; };
IN Turn turn(F x) {
    const F y = x * 0x1.45f306p-1f, far = all_f(0x1.8p+23f);
    const F n = (y + far) - far;
    const I quadrant = __builtin_convertvector(n, I);
    const F r = ((x - n * 0x1.92p+0f) - n * 0x1.fb4p-12f) - n * 0x1.4442d2p-24f, r2 = r * r;
    const F s = r + r * r2 * (-0x1.555546p-3f + r2 * (0x1.11073cp-7f + r2 * -0x1.994ebp-13f));
    const F c = 1 + r2 * (-0.5f + r2 * (0x1.55554ap-5f + r2 * (-0x1.6c0c1ep-10f + r2 * 0x1.99eb9cp-16f)));
    const I odd = (quadrant & 1) != 0;
    const F a = odd ? c : s, b = odd ? s : c;
    Turn found{(F)((I)a ^ ((quadrant & 2) << 30)), (F)((I)b ^ (((quadrant + 1) & 2) << 30))};
    const I large = !(m_abs(x) < 8192.0f);
    for (int i = 0; i < LANES; i++) if (large[i]) { found.sin = m_sin(x); found.cos = m_cos(x); break; }
    return found;
}
#endif
#if !(BYTES >= 32 && FAST && !WIDE)
IN F m_inverse_root(F x) { return 1 / m_sqrt(x); }
#endif
#if BYTES == 64
IN D m_sqrt(D x) {
    union { D whole; __m512d part[sizeof(D) / 64]; } u{x};
    for (auto& p : u.part) p = _mm512_sqrt_pd(p);
    return u.whole;
}
#elif BYTES == 32
IN D m_sqrt(D x) {
    union { D whole; __m256d part[sizeof(D) / 32]; } u{x};
    for (auto& p : u.part) p = _mm256_sqrt_pd(p);
    return u.whole;
}
#else
IN D m_sqrt(D x) { for (int i = 0; i < LANES; i++) x[i] = __builtin_sqrt(x[i]); return x; }
#endif

// The product of a matrix and a vector of registers, so many rows at a time that their sums stay in registers. FIRST: where the
// first number of each column is; the next is DOWN further.
#define EACH_SUM _Pragma("GCC unroll 16") for (int k = 0; k < N; k++)
template <int N, int DOWN, int... FIRST, class V, class T> IN void some_rows(V* to, const V* from, const T* matrix) {
    static constexpr int first[] = {FIRST...};
    V sum[N];
    EACH_SUM sum[k] = from[0] * matrix[first[0] + k * DOWN];
    for (int i = 1; i < int(sizeof...(FIRST)); i++) {
        const T* column = matrix + first[i];
        EACH_SUM sum[k] += from[i] * column[k * DOWN];
    }
    EACH_SUM to[k] = sum[k];
}
template <int ROWS, int DOWN, int... FIRST, class V, class T> UNMIXED static void matrix(V* to, const V* from, const T* matrix) {
    constexpr int MOST = 12, PARTS = (ROWS + MOST - 1) / MOST, LESS = ROWS / PARTS, MORE = ROWS % PARTS;
    for (int part = 0; part < MORE; part++, to += LESS + 1, matrix += (LESS + 1) * DOWN)
        some_rows<LESS + 1, DOWN, FIRST...>(to, from, matrix);
    for (int part = MORE; part < PARTS; part++, to += LESS, matrix += LESS * DOWN)
        some_rows<LESS, DOWN, FIRST...>(to, from, matrix);
}

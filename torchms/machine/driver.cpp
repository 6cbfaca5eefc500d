// What is around the generated `body` and `prelude`: how elements are brought to it and where results go.

// Elements are staged in pieces of so many, which stay in the first cache.
constexpr int64_t PIECE = 512;

static inline int64_t padded(int64_t count) { return (count + LANES - 1) / LANES * LANES; }

struct Column {  // of an input: element (row, path) is at data + row · row_step + path · path_step [bytes];
    const char* data;  // without data, the number row · row_step + path · path_step + base
    int64_t row_step, path_step, base;
};

struct Result {  // element (row, path) goes to data + row · row_step + path · path_step [bytes]
    char* data;
    int64_t row_step, path_step;
    int64_t how;  // 0: one a path; 1: times `scale`, summed over the paths; 2: summed over all elements, as a double
};

struct Check {  // that numbers lie in [low, high]: what, 0: the squared length of the vector in columns index, index + 1 and index + 2;
    double what, index, count, low, high;  // 1: column `index`; 2 and 3: `count` floats or doubles of shared tensor `index`
};

struct Call {
    const Column* columns;
    const Result* results;
    const char* cells;
    const void* const* shared;
    const Check* checks;
    int64_t n_checks;
    double scale;
    bool* bad;
};

template <class T>
static void fill(T* to, const char* from, int64_t step, int64_t count) {
    if (step == sizeof(T)) std::memcpy(to, from, count * sizeof(T));
    else if (step == 0) { const T value = *(const T*)from; for (int64_t i = 0; i < count; i++) to[i] = value; }
    else for (int64_t i = 0; i < count; i++) to[i] = *(const T*)(from + i * step);
}

template <class T>
static void count_up(T* to, int64_t first, int64_t step, int64_t count) {
    for (int64_t i = 0; i < count; i++) to[i] = T(first + i * step);
}

template <class T>
static void finish(T* x, int64_t count) {
    for (int64_t i = count; i < padded(count); i++) x[i] = x[count - 1];
}

// Three components of one vector after another: read together, which shuffles whole registers.
static void apart(float* __restrict x, float* __restrict y, float* __restrict z, const float* __restrict from, int64_t count) {
    for (int64_t i = 0; i < count; i++) { x[i] = from[3 * i]; y[i] = from[3 * i + 1]; z[i] = from[3 * i + 2]; }
}

struct Stage {
    alignas(64) char in[N_COLUMNS + 1][PIECE * 8];
    alignas(64) char out[N_RESULTS + 1][PIECE * 8];
    alignas(64) char sum[N_RESULTS + 1][PIECE * 8];
    const void* columns[N_COLUMNS + 1];
    void* results[N_RESULTS + 1];
};

static void bring(Stage& s, const Call& c, int64_t row, int64_t path, bool by_rows, int64_t count, bool first) {
    for (int k = 0; k < N_COLUMNS; k++) {
        const Column& in = c.columns[k];
        // What is the same for every path is brought once.
        if (by_rows && !first && in.path_step == 0) continue;
        const int64_t step = by_rows ? in.row_step : in.path_step;
        void* to = s.in[k];
        s.columns[k] = to;
        if (in.data == nullptr) {
            const int64_t start = in.base + row * in.row_step + path * in.path_step;
            if (COLUMN_SIZE[k] == 8) { count_up((int64_t*)to, start, step, count); finish((int64_t*)to, count); }
            else { count_up((int32_t*)to, start, step, count); finish((int32_t*)to, count); }
            continue;
        }
        const char* from = in.data + row * in.row_step + path * in.path_step;
        if (step == COLUMN_SIZE[k] && count % LANES == 0) { s.columns[k] = from; continue; }
        if (step == 12 && COLUMN_SIZE[k] == 4 && k + 2 < N_COLUMNS && COLUMN_SIZE[k + 1] == 4 && COLUMN_SIZE[k + 2] == 4
            && c.columns[k + 1].data == in.data + 4 && c.columns[k + 2].data == in.data + 8
            && c.columns[k + 1].row_step == in.row_step && c.columns[k + 2].row_step == in.row_step
            && c.columns[k + 1].path_step == in.path_step && c.columns[k + 2].path_step == in.path_step) {
            float *x = (float*)to, *y = (float*)s.in[k + 1], *z = (float*)s.in[k + 2];
            apart(x, y, z, (const float*)from, count);
            finish(x, count); finish(y, count); finish(z, count);
            s.columns[k + 1] = y; s.columns[k + 2] = z;
            k += 2;
            continue;
        }
        switch (COLUMN_SIZE[k]) {
            case 8: fill((int64_t*)to, from, step, count); finish((int64_t*)to, count); break;
            case 4: fill((int32_t*)to, from, step, count); finish((int32_t*)to, count); break;
            default: fill((char*)to, from, step, count); finish((char*)to, count);
        }
    }
}

template <class T>
static void put(const Result& out, char* to, int64_t step, const T* from, T factor, int64_t count) {
    if (step == sizeof(T)) for (int64_t i = 0; i < count; i++) ((T*)to)[i] = from[i] * factor;
    else for (int64_t i = 0; i < count; i++) *(T*)(to + i * step) = from[i] * factor;
}

template <class T>
static void take(const Call& c, int k, Stage& s, int64_t row, int64_t path, bool by_rows, int64_t count, bool first, bool last, double* sums, double* totals) {
    const Result& out = c.results[k];
    T* found = (T*)s.out[k];
    T* sum = (T*)s.sum[k];
    if (out.how == 2) {
        // In double, a few sums side by side.
        double part[8] = {0, 0, 0, 0, 0, 0, 0, 0};
        int64_t i = 0;
        for (; i + 8 <= count; i += 8) for (int j = 0; j < 8; j++) part[j] += found[i + j];
        for (; i < count; i++) part[0] += found[i];
        totals[k] += ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
    } else if (out.how == 0) {
        char* to = out.data + row * out.row_step + path * out.path_step;
        if ((char*)s.results[k] != to) put<T>(out, to, by_rows ? out.row_step : out.path_step, found, T(1), count);
    } else if (by_rows) {
        char* to = out.data + row * out.row_step;
        if (first && last) { if ((char*)s.results[k] != to) put<T>(out, to, out.row_step, found, T(c.scale), count); return; }
        if (first) std::memcpy(sum, found, count * sizeof(T));
        else for (int64_t i = 0; i < count; i++) sum[i] += found[i];
        if (last) put<T>(out, to, out.row_step, sum, T(c.scale), count);
    } else {
        const double before = first ? 0.0 : sums[k];
        double part[8] = {0, 0, 0, 0, 0, 0, 0, 0};
        int64_t i = 0;
        for (; i + 8 <= count; i += 8) for (int j = 0; j < 8; j++) part[j] += found[i + j];
        for (; i < count; i++) part[0] += found[i];
        sums[k] = before + (((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7])));
        if (last) *(T*)(out.data + row * out.row_step) = T(sums[k] * c.scale);
    }
}

// NaN is in no range: no comparison with it is true.
template <class T>
static bool outside(const void* x, int64_t count, double low, double high) {
    bool bad = false;
    for (int64_t i = 0; i < count; i++) bad |= !(((const T*)x)[i] >= T(low) && ((const T*)x)[i] <= T(high));
    return bad;
}

extern "C" int64_t shared_stray(const void* const* shared, const Check* checks, int64_t n_checks) {
    bool bad = false;
    for (const Check* k = checks; k < checks + n_checks; k++) {
        if (k->what == 2) bad |= outside<float>(shared[int64_t(k->index)], int64_t(k->count), k->low, k->high);
        if (k->what == 3) bad |= outside<double>(shared[int64_t(k->index)], int64_t(k->count), k->low, k->high);
    }
    return bad;
}

template <class V, class T, V load(const void*, int64_t)>
static bool stray(const void* const* columns, const Check& k, int64_t count) {
    const V low = T(k.low) - V{}, high = T(k.high) - V{};
    auto good = low == low;
    if (k.what == 0)
        for (int64_t i = 0; i < count; i += LANES) {
            const V x = load(columns[0], i), y = load(columns[1], i), z = load(columns[2], i), length2 = x * x + y * y + z * z;
            good &= (length2 >= low) & (length2 <= high);
        }
    else
        for (int64_t i = 0; i < count; i += LANES) {
            const V x = load(columns[0], i);
            good &= (x >= low) & (x <= high);
        }
    for (int j = 0; j < LANES; j++) if (!good[j]) return true;
    return false;
}

// Whether a column of this piece is bad; what is the same for every path is looked at once.
static bool strays(const Stage& s, const Call& c, bool by_rows, int64_t count, bool first) {
    bool bad = false;
    for (const Check* k = c.checks; k < c.checks + c.n_checks; k++) {
        const int64_t i = int64_t(k->index);
        if (k->what > 1 || (by_rows && !first && c.columns[i].path_step == 0)) continue;
        if (COLUMN_SIZE[i] == 4) bad |= stray<F, float, load_f>(s.columns + i, *k, count);
        else bad |= stray<D, double, load_d>(s.columns + i, *k, count);
    }
    return bad;
}

static void piece(Stage& s, const Call& c, int64_t row, int64_t path, bool by_rows, int64_t count, bool first, bool last, double* sums, double* totals) {
    bring(s, c, row, path, by_rows, count, first);
    if (c.n_checks) *c.bad |= strays(s, c, by_rows, padded(count), first);
    for (int k = 0; k < N_RESULTS; k++) {
        const Result& out = c.results[k];
        const int64_t step = by_rows ? out.row_step : out.path_step;
        // Straight to where it stays, if nothing is to be done with it on the way.
        const bool straight = count % LANES == 0 && step == RESULT_SIZE[k]
            && (out.how == 0 || (out.how == 1 && by_rows && first && last && c.scale == 1));
        s.results[k] = straight ? out.data + row * out.row_step + path * out.path_step : s.out[k];
    }
    body(s.columns, s.results, c.cells, c.shared, padded(count));
    for (int k = 0; k < N_RESULTS; k++)
        if (RESULT_SIZE[k] == 4) take<float>(c, k, s, row, path, by_rows, count, first, last, sums, totals);
        else take<double>(c, k, s, row, path, by_rows, count, first, last, sums, totals);
}

// Rows [row, row_end) and paths [path, path_end), many elements along the one or along the other; whether numbers are bad.
extern "C" int64_t run(const Column* columns, const Result* results, const char* cells, const void* const* shared, const Check* checks, int64_t n_checks,
                       double scale, int64_t row, int64_t row_end, int64_t path, int64_t path_end, int64_t by_rows, double* totals) {
    static thread_local Stage s;
    bool bad = false;
    const Call c{columns, results, cells, shared, checks, n_checks, scale, &bad};
    double sums[N_RESULTS + 1];
    if (by_rows)
        for (int64_t r = row; r < row_end; r += PIECE) {
            const int64_t count = row_end - r < PIECE ? row_end - r : PIECE;
            for (int64_t p = path; p < path_end; p++) piece(s, c, r, p, true, count, p == path, p + 1 == path_end, sums, totals);
        }
    else
        for (int64_t r = row; r < row_end; r++)
            for (int64_t p = path; p < path_end; p += PIECE) {
                const int64_t count = path_end - p < PIECE ? path_end - p : PIECE;
                piece(s, c, r, p, false, count, p == path, p + count == path_end, sums, totals);
            }
    return bad;
}

// What `prelude` and `run` do, of few elements: words are the columns, the results, the shared tensors and room for cells.
extern "C" int64_t at_once(int64_t* words, int64_t n_shared, const Check* checks, int64_t n_checks, double scale, int64_t rows, int64_t paths, int64_t by_rows) {
    const auto* results = (const Result*)(words + 4 * N_COLUMNS);
    const auto* shared = (const void* const*)(words + 4 * (N_COLUMNS + N_RESULTS));
    char* cells = (char*)(words + 4 * (N_COLUMNS + N_RESULTS) + n_shared);
    prelude(shared, cells);
    const bool bad = shared_stray(shared, checks, n_checks);
    double totals[N_RESULTS + 1];
    return run((const Column*)words, results, cells, shared, checks, n_checks, scale, 0, rows, 0, paths, by_rows, totals) || bad;
}

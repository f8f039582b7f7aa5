//! The radix sort that puts splats in order on the device: stable, least significant digit first (Satish, Harris and Garland,
//! "Designing Efficient Sorting Algorithms for Manycore GPUs", 2009), of keys of any number of 32-bit words.
//!
//! A digit has four bits. Each invocation takes sixteen keys that lie together, and counts their digits in a column of its own in memory
//! of the workgroup: no atomics are needed, so that what comes out depends on nothing but the keys. Counts of two digits
//! share a number, sixteen bits each, for at most 4096 keys are counted: 8 KiB hold the columns of 256 invocations. Sums along the
//! rows are the places within the workgroup, and sums over workgroups ([`scan`]) where these begin.
//!
//! What begins in order of its number and is sorted stably keeps that order where keys are equal.

use crate::fields::{Code, KernelBuilder};
use crate::program::kernel::{BinaryOp, Expr, Function, Stage, Ty};
use crate::program::{FrameValue, SortBuffer, SortPass};

const THREADS: u32 = SortPass::THREADS;
/// Keys of an invocation.
const EACH: u32 = SortPass::TAKES / THREADS;
const DIGITS: u32 = 1 << SortPass::DIGIT;
/// Rows of counts: two digits in each.
const ROWS: u32 = DIGITS / 2;
/// Neighbours in a row that one invocation sums up, and invocations of a row then.
const PART: u32 = ROWS;
const LANES: u32 = THREADS / ROWS;

pub(super) const GROUP: Stage = Stage::Compute([THREADS, 1, 1]);

fn op(op: BinaryOp, a: &Expr, b: impl Into<Expr>) -> Expr {
    Expr::binary(op, a.clone(), b)
}

/// The number of the workgroup, and of the invocation in it.
pub(super) fn place(code: &mut Code) -> (Expr, Expr) {
    let row = Expr::GroupId.component(1) * SortPass::ROW;
    let group = code.bind("group", Ty::U32, Expr::GroupId.component(0) + row);
    (group, code.bind("lane", Ty::U32, Expr::LocalIndex))
}

/// A loop over a variable from 0 up to a number.
pub(super) fn each(code: &mut Code, name: &str, end: impl Into<Expr>, body: impl FnOnce(&mut Code, &Expr)) {
    let at = code.var(name, Ty::U32, 0u32);
    let end = end.into();
    code.loop_(|code| {
        code.break_if(Expr::Local(at).greater_equal(end));
        let own = code.bind(name, Ty::U32, Expr::Local(at));
        code.set(at, Expr::Local(at) + 1u32);
        body(code, &own);
    });
}

/// What the kernels of a sort share.
struct Sort {
    count: Expr,
    word: Expr,
    shift: Expr,
    /// Counts of digits, and sums of eight of them.
    columns: u32,
    sums: u32,
    group: Expr,
    lane: Expr,
}

impl Sort {
    fn new(builder: &mut KernelBuilder, code: &mut Code) -> Self {
        let (group, lane) = place(code);
        Self {
            count: builder.frame(FrameValue::SortCount),
            word: builder.frame(FrameValue::SortWord),
            shift: builder.frame(FrameValue::SortShift),
            columns: builder.workgroup("columns", THREADS * ROWS),
            sums: builder.workgroup("sums", THREADS),
            group,
            lane,
        }
    }

    /// Goes through the keys of this invocation; `body` gets a key, and what holds its number if that is asked for.
    fn keys(
        &self,
        builder: &mut KernelBuilder,
        code: &mut Code,
        numbered: bool,
        body: impl FnOnce(&mut Code, &Expr, &Expr),
    ) {
        let (words, keys, numbers) =
            (builder.keys_read(), builder.sorting(SortBuffer::KeysFrom), builder.sorting(SortBuffer::NumbersFrom));
        let first = self.group.clone() * SortPass::TAKES + self.lane.clone() * EACH;
        let first = code.bind("first", Ty::U32, first);
        each(code, "nth", EACH, |code, nth| {
            let at = code.bind("at", Ty::U32, first.clone() + nth.clone());
            code.break_if(at.clone().greater_equal(self.count.clone()));
            let (key, number) = (code.var("key", Ty::U32, 0u32), code.var("number", Ty::U32, at.clone()));
            let fresh = self.shift.clone().equal(0u32);
            let numbering = fresh.clone().and(self.word.clone().equal(0u32));
            let known = if numbered { !numbering } else { fresh.clone().and(!numbering) };
            code.if_(known, |code| code.set(number, Expr::load(numbers, at.clone())));
            code.if_else(
                fresh,
                |code| code.set(key, Expr::load(words, self.word.clone() * self.count.clone() + Expr::Local(number))),
                |code| code.set(key, Expr::load(keys, at.clone())),
            );
            let key = code.bind("own_key", Ty::U32, key);
            let number = code.bind("own_number", Ty::U32, number);
            body(code, &key, &number);
        });
    }

    /// Where the column of this invocation counts the digit of a key, and by how many bits the count is shifted there.
    fn digit(&self, code: &mut Code, key: &Expr) -> (Expr, Expr, Expr) {
        let digit = op(BinaryOp::BitAnd, &op(BinaryOp::ShiftRight, key, self.shift.clone()), DIGITS - 1);
        let digit = code.bind("digit", Ty::U32, digit);
        let cell = op(BinaryOp::BitAnd, &digit, ROWS - 1) * THREADS + self.lane.clone();
        let cell = code.bind("cell", Ty::U32, cell);
        let half = code.bind("half", Ty::U32, op(BinaryOp::ShiftRight, &digit, ROWS.ilog2()) * 16u32);
        (digit, cell, half)
    }

    /// Counts digits in columns, and sums eight neighbours of a row. After a barrier all see these.
    fn tally(&self, builder: &mut KernelBuilder, code: &mut Code) -> Expr {
        for row in 0..ROWS {
            code.store(self.columns, self.lane.clone() + row * THREADS, Expr::U32(0));
        }
        self.keys(builder, code, false, |code, key, _| {
            let (_, cell, half) = self.digit(code, key);
            let one = op(BinaryOp::ShiftLeft, &Expr::U32(1), half);
            code.store(self.columns, cell.clone(), Expr::load(self.columns, cell) + one);
        });
        code.barrier();
        let sum = code.var("sum", Ty::U32, 0u32);
        each(code, "part", PART, |code, part| {
            code.add(sum, Expr::load(self.columns, self.lane.clone() * PART + part.clone()));
        });
        let sum = code.bind("own_sum", Ty::U32, sum);
        code.store(self.sums, self.lane.clone(), sum.clone());
        code.barrier();
        sum
    }
}

/// Sums of what each invocation has stored in `sums`, with all before it among so many (Hillis and Steele, "Data Parallel
/// Algorithms", 1986). Stands between two barriers.
pub(super) fn sum_up(code: &mut Code, (sums, lane): (u32, &Expr), among: u32) {
    let mut step = 1;
    while step < among {
        let there = op(BinaryOp::Rem, lane, among).greater_equal(step);
        let before = there.clone().select(lane.clone() - step, lane.clone());
        let before = code.bind("before", Ty::U32, Expr::load(sums, before));
        let sum = Expr::load(sums, lane.clone()) + there.select(before, 0u32);
        let sum = code.bind("sum_so_far", Ty::U32, sum);
        code.barrier();
        code.store(sums, lane.clone(), sum);
        code.barrier();
        step *= 2;
    }
}

/// How often each digit occurs in a workgroup.
fn count(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("sort_count", None);
    let sort = Sort::new(builder, &mut code);
    let tallies = builder.tallies();
    sort.tally(builder, &mut code);
    let groups = code.bind("groups", Ty::U32, blocks(&sort.count));
    let own = sort.lane.clone().less(DIGITS).and(sort.group.clone().less(groups.clone()));
    code.if_(own, |code| {
        let row = code.bind("row", Ty::U32, op(BinaryOp::BitAnd, &sort.lane, ROWS - 1) * LANES);
        let total = code.var("total", Ty::U32, 0u32);
        each(code, "part_of_row", LANES, |code, part| {
            code.add(total, Expr::load(sort.sums, row.clone() + part.clone()));
        });
        let half = op(BinaryOp::ShiftRight, &sort.lane, ROWS.ilog2()) * 16u32;
        let total = op(BinaryOp::BitAnd, &op(BinaryOp::ShiftRight, &total.into(), half), 0xffffu32);
        code.store(tallies, sort.lane.clone() * groups + sort.group.clone(), total);
    });
    code.finish(None)
}

/// Workgroups that have keys.
fn blocks(count: &Expr) -> Expr {
    (count.clone() + (SortPass::TAKES - 1)) / SortPass::TAKES
}

/// Makes of tallies the sums of all that come before each, in one workgroup.
fn scan(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("sort_scan", None);
    let lane = code.bind("lane", Ty::U32, Expr::LocalIndex);
    let (tallies, sums) = (builder.tallies(), builder.workgroup("sums", THREADS));
    let length = builder.frame(FrameValue::ScanLength);
    let share = code.bind("share", Ty::U32, (length.clone() + (THREADS - 1)) / THREADS);
    let first = code.bind("first", Ty::U32, (lane.clone() * share.clone()).min(length.clone()));
    let own = code.bind("own", Ty::U32, (first.clone() + share).min(length) - first.clone());
    let sum = code.var("sum", Ty::U32, 0u32);
    each(&mut code, "nth", own.clone(), |code, nth| code.add(sum, Expr::load(tallies, first.clone() + nth.clone())));
    let sum = code.bind("own_sum", Ty::U32, sum);
    code.store(sums, lane.clone(), sum.clone());
    code.barrier();
    sum_up(&mut code, (sums, &lane), THREADS);
    let next = code.var("next", Ty::U32, Expr::load(sums, lane) - sum);
    each(&mut code, "nth", own, |code, nth| {
        let at = code.bind("at", Ty::U32, first + nth.clone());
        let tally = code.bind("tally", Ty::U32, Expr::load(tallies, at.clone()));
        code.store(tallies, at, next.into());
        code.add(next, tally);
    });
    code.finish(None)
}

/// Puts keys and numbers where they belong.
fn scatter(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("sort_scatter", None);
    let sort = Sort::new(builder, &mut code);
    let tallies = builder.tallies();
    let (keys, numbers) = (builder.sorting(SortBuffer::KeysTo), builder.sorting(SortBuffer::NumbersTo));
    let sum = sort.tally(builder, &mut code);
    sum_up(&mut code, (sort.sums, &sort.lane), LANES);
    // From how many there are to how many come before, in the same digit.
    let next = code.var("next", Ty::U32, Expr::load(sort.sums, sort.lane.clone()) - sum);
    each(&mut code, "part", PART, |code, part| {
        let at = code.bind("at", Ty::U32, sort.lane.clone() * PART + part.clone());
        let tally = code.bind("tally", Ty::U32, Expr::load(sort.columns, at.clone()));
        code.store(sort.columns, at, next.into());
        code.add(next, tally);
    });
    code.barrier();
    let groups = code.bind("groups", Ty::U32, blocks(&sort.count));
    sort.keys(builder, &mut code, true, |code, key, number| {
        let (digit, cell, half) = sort.digit(code, key);
        let before = code.bind("all_before", Ty::U32, Expr::load(sort.columns, cell.clone()));
        let own = op(BinaryOp::BitAnd, &op(BinaryOp::ShiftRight, &before, half.clone()), 0xffffu32);
        let to = Expr::load(tallies, digit * groups + sort.group.clone()) + own;
        let to = code.bind("to", Ty::U32, to);
        code.store(keys, to.clone(), key.clone());
        code.store(numbers, to, number.clone());
        code.store(sort.columns, cell, before + op(BinaryOp::ShiftLeft, &Expr::U32(1), half));
    });
    code.finish(None)
}

/// The first of so many sorted numbers in a buffer that is not less than another.
pub(super) fn lower_bound(code: &mut Code, (buffer, count): (u32, &Expr), wanted: &Expr) -> Expr {
    let (low, high) = (code.var("low", Ty::U32, 0u32), code.var("high", Ty::U32, count.clone()));
    code.loop_(|code| {
        code.break_if(Expr::Local(low).greater_equal(Expr::Local(high)));
        let middle = Expr::Local(low) + (Expr::Local(high) - Expr::Local(low)) / 2u32;
        let middle = code.bind("middle", Ty::U32, middle);
        code.if_else(
            Expr::load(buffer, middle.clone()).less(wanted.clone()),
            |code| code.set(low, middle.clone() + 1u32),
            |code| code.set(high, middle.clone()),
        );
    });
    code.bind("bound", Ty::U32, low)
}

/// How many of the sorted keys are of something that is drawn.
pub(super) fn drawn(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("drawn", None);
    let (keys, tallies) = (builder.sorting(SortBuffer::KeysFrom), builder.tallies());
    let count = builder.frame(FrameValue::SortCount);
    let bound = lower_bound(&mut code, (keys, &count), &Expr::U32(SortPass::LAST));
    code.store(tallies, Expr::U32(0), bound);
    code.finish(None)
}

/// An f32 that is not NaN as a number that grows with it.
pub(super) fn key(code: &mut Code, value: Expr) -> Expr {
    let bits = code.bind("bits", Ty::U32, value.bitcast(crate::program::kernel::Prim::U32));
    let negative = op(BinaryOp::ShiftRight, &bits, 31u32).greater(0u32);
    // Negative numbers run backwards; the others lie above them.
    let flipped = negative.select(op(BinaryOp::BitXor, &bits, u32::MAX), op(BinaryOp::BitOr, &bits, 1u32 << 31));
    code.bind("depth_key", Ty::U32, flipped)
}

/// Adds the kernels of a sort to the others, and says which they are.
pub(super) fn add(builder: &mut KernelBuilder, entries: &mut Vec<(&str, Stage, Function)>, words: u32) -> SortPass {
    let first = entries.len() as u32;
    entries.push(("sort_count", GROUP, count(builder)));
    entries.push(("sort_scan", GROUP, scan(builder)));
    entries.push(("sort_scatter", GROUP, scatter(builder)));
    SortPass { count: first, scan: first + 1, scatter: first + 2, words }
}

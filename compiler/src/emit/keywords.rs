//! Words that GLSL, HLSL and MSL keep for themselves, beyond those of WGSL, which naga lists publicly.
//!
//! A scene's `line` or `half` would otherwise be renamed by some writers and not by others. Words that end in a digit are
//! not listed: no name of ours ends so.

use rustc_hash::FxHashSet;
use std::sync::LazyLock;

const OTHERS: &str = "
    AcceptHitAndEndSearch AllMemoryBarrier AllMemoryBarrierWithGroupSync AllocateRayQuery AppendStructuredBuffer
    BlendState Buffer ByteAddressBuffer CHAR_BIT CHAR_MAX CHAR_MIN CallShader CheckAccessFullyMapped CompileShader
    ComputeShader ConstantBuffer ConsumeStructuredBuffer CreateResourceFromHeap DBL_DECIMAL_DIG DBL_DIG DBL_EPSILON
    DBL_MANT_DIG DBL_MAX DBL_MAX_10_EXP DBL_MAX_EXP DBL_MIN DBL_MIN_10_EXP DBL_MIN_EXP DBL_RADIX DefaultConstructible
    DepthStencilState DepthStencilView DeviceMemoryBarrier DeviceMemoryBarrierWithGroupSync DispatchMesh
    DispatchRaysDimensions DispatchRaysIndex DomainShader EmitStreamVertex EmitVertex EndPrimitive EndStreamPrimitive
    EvaluateAttributeAtSample EvaluateAttributeCentroid EvaluateAttributeSnapped FLT_DECIMAL_DIG FLT_DIG FLT_EPSILON
    FLT_MANT_DIG FLT_MAX FLT_MAX_10_EXP FLT_MAX_EXP FLT_MIN FLT_MIN_10_EXP FLT_MIN_EXP FLT_RADIX FP_ILOGBNAN
    FeedbackTexture2D FeedbackTexture2DArray GeometryIndex GeometryShader GetAttributeAtVertex
    GetRenderTargetSampleCount GetRenderTargetSamplePosition GroupMemoryBarrier GroupMemoryBarrierWithGroupSync
    HALF_DECIMAL_DIG HALF_DIG HALF_EPSILON HALF_MANT_DIG HALF_MAX HALF_MAX_10_EXP HALF_MAX_EXP HALF_MIN
    HALF_MIN_10_EXP HALF_MIN_EXP HALF_RADIX HUGE_VAL HUGE_VALF HUGE_VALH HitKind Hullshader INFINITY INT_MAX INT_MIN
    IgnoreHit InputPatch InstanceID InstanceIndex InterlockedAdd InterlockedAnd InterlockedCompareExchange
    InterlockedCompareExchangeFloatBitwise InterlockedCompareStore InterlockedCompareStoreFloatBitwise
    InterlockedExchange InterlockedMax InterlockedMin InterlockedOr InterlockedXor IsHelperLane LLONG_MAX LLONG_MIN
    LONG_MAX LONG_MIN LineStream MAXDOUBLE MAXFLOAT MAXHALF M_1_PI M_1_PI_F M_1_PI_H M_2_PI M_2_PI_F M_2_PI_H
    M_2_SQRTPI M_2_SQRTPI_F M_2_SQRTPI_H M_E M_E_F M_E_H M_LN10_F M_LN10_H M_LN2_F M_LN2_H M_LOG10E M_LOG10E_F
    M_LOG10E_H M_LOG2E M_LOG2E_F M_LOG2E_H M_PI M_PI_2_F M_PI_2_H M_PI_4_F M_PI_4_H M_PI_F M_PI_H M_SQRT1_2_F
    M_SQRT1_2_H M_SQRT2_F M_SQRT2_H NAN NonUniformResourceIndex ObjectRayDirection ObjectRayOrigin ObjectToWorld
    OutputPatch PixelShader PointStream PrimitiveIndex Process2DQuadTessFactorsAvg Process2DQuadTessFactorsMax
    Process2DQuadTessFactorsMin ProcessIsolineTessFactors ProcessQuadTessFactorsAvg ProcessQuadTessFactorsMax
    ProcessQuadTessFactorsMin ProcessTriTessFactorsAvg ProcessTriTessFactorsMax ProcessTriTessFactorsMin QuadAll
    QuadAny QuadReadAcrossDiagonal QuadReadAcrossX QuadReadAcrossY QuadReadLaneAt RWBuffer RWByteAddressBuffer
    RWStructuredBuffer RWTexture1D RWTexture1DArray RWTexture2D RWTexture2DArray RWTexture2DMS RWTexture2DMSArray
    RWTexture3D RWTextureCube RWTextureCubeArray RasterizerOrderedBuffer RasterizerOrderedByteAddressBuffer
    RasterizerOrderedStructuredBuffer RasterizerOrderedTexture1D RasterizerOrderedTexture1DArray
    RasterizerOrderedTexture2D RasterizerOrderedTexture2DArray RasterizerOrderedTexture3D RasterizerState RayDesc
    RayFlags RayQuery RayTCurrent RayTMin RaytracingAccelerationStructure RenderTargetView ReportHit SCHAR_MAX
    SCHAR_MIN SHRT_MAX SHRT_MIN SamplerComparisonState SamplerState SetMeshOutputCounts StructuredBuffer Technique
    Texture1D Texture1DArray Texture2D Texture2DArray Texture2DMS Texture2DMSArray Texture3D TextureBuffer TextureCube
    TextureCubeArray TraceRay TriangleStream UCHAR_MAX UINT_MAX ULLONG_MAX ULONG_MAX USHRT_MAX VertexShader
    WaveActiveAllEqual WaveActiveAllTrue WaveActiveAnyTrue WaveActiveBallot WaveActiveBitAnd WaveActiveBitOr
    WaveActiveBitXor WaveActiveCountBits WaveActiveMax WaveActiveMin WaveActiveProduct WaveActiveSum WaveGetLaneCount
    WaveGetLaneIndex WaveIsFirstLane WaveMatch WaveMultiPrefixBitAnd WaveMultiPrefixBitOr WaveMultiPrefixBitXor
    WaveMultiPrefixCountBits WaveMultiPrefixProduct WaveMultiPrefixSum WavePrefixCountBits WavePrefixProduct
    WavePrefixSum WaveReadLaneAt WaveReadLaneFirst WorldRayDirection WorldRayOrigin WorldToObject abort allInvocations
    allInvocationsEqual and and_eq anyInvocation as_type asdouble asfloat asint assert asuint atomicCompSwap
    atomicCounter atomicCounterAdd atomicCounterAnd atomicCounterCompSwap atomicCounterDecrement atomicCounterExchange
    atomicCounterIncrement atomicCounterMax atomicCounterMin atomicCounterOr atomicCounterSubtract atomicCounterXor
    atomic_bool atomic_float atomic_int atomic_uint atomic_ulong barrier bfloat bitCount bitand bitfieldExtract
    bitfieldInsert bitfieldReverse bitor buffer cbuffer center centroid char char16_t char32_t clip compl complex
    constant countbits dFdx dFdxCoarse dFdxFine dFdy dFdyCoarse dFdyFine ddx ddx_coarse ddx_fine ddy ddy_coarse
    ddy_fine decl device dot2add dot4add_i8packed dot4add_u8packed double dst dword equal errorf faceforward findLSB
    findMSB firstbithigh firstbitlow fixed flat float float16_t float32_t float64_t floatBitsToInt floatBitsToUint
    fmod frac fragment ftransform globallycoherent greaterThan greaterThanEqual groupMemoryBarrier half iimage1D
    iimage1DArray iimage2D iimage2DArray iimage2DMS iimage2DMSArray iimage2DRect iimage3D iimageBuffer iimageCube
    iimageCubeArray image1D image1DArray image1DArrayShadow image1DShadow image2D image2DArray image2DArrayShadow
    image2DMS image2DMSArray image2DRect image2DShadow image3D imageAtomicAdd imageAtomicAnd imageAtomicCompSwap
    imageAtomicExchange imageAtomicMax imageAtomicMin imageAtomicOr imageAtomicXor imageBuffer imageCube
    imageCubeArray imageLoad imageSamples imageSize imageStore imaginary imulExtended in indices inout input int
    int16_t int32_t int64_t int8_t int8_t4_packed intBitsToFloat interpolateAtCentroid interpolateAtOffset
    interpolateAtSample invariant inverse inversesqrt isampler1D isampler1DArray isampler2D isampler2DArray
    isampler2DMS isampler2DMSArray isampler2DRect isampler3D isamplerBuffer isamplerCube isamplerCubeArray isfinite
    isinf isnan isubpassInput isubpassInputMS itexture1D itexture1DArray itexture2D itexture2DArray itexture2DMS
    itexture2DMSArray itexture2DRect itexture3D itextureBuffer itextureCube itextureCubeArray kernel lerp lessThan
    lessThanEqual line lineadj linear lit llong long mad main matrix matrixCompMult memoryBarrier
    memoryBarrierAtomicCounter memoryBarrierBuffer memoryBarrierImage memoryBarrierShared metal min10float min12int
    min16float min16int min16uint mul noise not notEqual not_eq object_data or or_eq out outerProduct output packed
    packed_vec payload point primitives printf ptrdiff_t quad ray_data rcp reversebits roundEven row_major rsqrt
    sample sampler1D sampler1DArray sampler1DArrayShadow sampler1DShadow sampler2D sampler2DArray sampler2DArrayShadow
    sampler2DMS sampler2DMSArray sampler2DRect sampler2DRectShadow sampler2DShadow sampler3D sampler3DRect
    samplerBuffer samplerCube samplerCubeArray samplerCubeArrayShadow samplerCubeShadow samplerShadow sampler_state
    shadow1D shadow1DLod shadow1DProj shadow1DProjLod shadow2D shadow2DLod shadow2DProj shadow2DProjLod short signed
    sincos size_t source_mark stateblock stateblock_state string subpassInput subpassInputMS subpassLoad superp
    tbuffer technique tex1D tex1Dbias tex1Dgrad tex1Dlod tex1Dproj tex2D tex2Dbias tex2Dgrad tex2Dlod tex2Dproj tex3D
    tex3Dbias tex3Dgrad tex3Dlod tex3Dproj texCUBE texCUBEbias texCUBEgrad texCUBElod texCUBEproj texelFetch
    texelFetchOffset texture texture1D texture1DArray texture1DLod texture1DProj texture1DProjLod texture2D
    texture2DArray texture2DLod texture2DMS texture2DMSArray texture2DProj texture2DProjLod texture2DRect texture3D
    texture3DLod texture3DProj texture3DProjLod textureBuffer textureCube textureCubeArray textureCubeLod
    textureGatherOffset textureGatherOffsets textureGrad textureGradOffset textureLod textureLodOffset textureOffset
    textureProj textureProjGrad textureProjGradOffset textureProjLod textureProjLodOffset textureProjOffset
    textureQueryLevels textureQueryLod textureSamples textureSize thread threadgroup threadgroup_imageblock triangle
    triangleadj uaddCarry uchar uimage1D uimage1DArray uimage2D uimage2DArray uimage2DMS uimage2DMSArray uimage2DRect
    uimage3D uimageBuffer uimageCube uimageCubeArray uint uint16_t uint32_t uint64_t uint8_t uint8_t4_packed
    uintBitsToFloat ullong umulExtended unsigned usampler1D usampler1DArray usampler2D usampler2DArray usampler2DMS
    usampler2DMSArray usampler2DRect usampler3D usamplerBuffer usamplerCube usamplerCubeArray ushort usubBorrow
    usubpassInput usubpassInputMS utexture1D utexture1DArray utexture2D utexture2DArray utexture2DMS utexture2DMSArray
    utexture2DRect utexture3D utextureBuffer utextureCube utextureCubeArray vec vector vertex vertexfragment vertices
    void wchar_t xor xor_eq
";

/// What FXC reads as its own word in any case of letters.
const ANY_CASE: [&str; 5] = ["asm", "decl", "pass", "technique", "texturecube"];

static ALL: LazyLock<FxHashSet<&'static str>> = LazyLock::new(|| {
    let wgsl = naga::keywords::wgsl::RESERVED.iter().chain(naga::keywords::wgsl::BUILTIN_IDENTIFIERS).copied();
    wgsl.chain(OTHERS.split_whitespace()).collect()
});

/// Whether some target keeps this word for itself.
pub(super) fn is_taken(word: &str) -> bool {
    ALL.contains(word) || ANY_CASE.iter().any(|w| w.eq_ignore_ascii_case(word))
}
